"""Compiled loops that tell which points say where a scan lies: those that lie on the surface that they are compared to.

The line of a surfel says how far a point lies off it, and which way the point would have to go. Both are wrong beyond
the end of what was seen of the surface, as where a wall comes within the laser's range: the normal errs, and the line
through it leads the farther astray the farther away it ends. Together such points pull a scan back to where the walls
ended before, as if the robot had not moved. They are wrong, too, where the normals of point and surfel differ by more
than either errs on a wall, as at a corner, a leg or the first few points of a wall. ICP leaves out pairs at the
boundary of a mesh for the same reason (Turk and Levoy, *Zippered polygon meshes from range images*, 1994).
"""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled_for_both

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]


@compiled_for_both
def beyond_end(x: float, y: float, k: int, surfels: F64, nearest: I32, x0: float, y0: float, per_metre: float) -> bool:
    """Whether (x, y) lies beyond where the surface of its surfel was seen to go on: nothing lies along it over there.

    Args:
        x: of the point, reference frame [m] …
        y: … as this.
        k: its surfel, one of …
        surfels: … (m, 4) x, y and unit normal.
        nearest: (ny, nx) surfel nearest to each cell of the field, -1 for none.
        x0: lower left corner of the field [m] …
        y0: … as this.
        per_metre: its cells in a metre; what is no farther off than one belongs to its surfel.
    """
    sx, sy, nx, ny = surfels[k, 0], surfels[k, 1], surfels[k, 2], surfels[k, 3]
    along = nx * (y - sy) - ny * (x - sx)
    if abs(along) * per_metre <= 1.0:
        return False
    # As far behind the point as the surfel lies before it.
    u, v = (sx - 2.0 * along * ny - x0) * per_metre, (sy + 2.0 * along * nx - y0) * per_metre
    if not (u >= 0.0 and v >= 0.0 and u < nearest.shape[1] and v < nearest.shape[0]):
        return True
    other = nearest[np.uint32(v), np.uint32(u)]
    if other < 0:
        return True
    reached = nx * (surfels[other, 1] - sy) - ny * (surfels[other, 0] - sx)
    return bool(reached < along if along > 0.0 else reached > along)
