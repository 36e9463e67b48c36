"""Where a robot can be: a raster of the distance to the nearest wall, and the largest place that hangs together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from frontends.simulator.world import Segments

Points = NDArray[np.float64]
Cells = NDArray[np.int64]

CELL = 0.1
"""Side of a cell of the raster [m]."""
CLEARANCE = 0.38
"""Free cells are farther than this from the nearest cell with a wall [m]: 0.3 m for a robot, and half a diagonal."""
_MARGIN = 1.0  # m: of the raster around the walls
_LEAST_INSIDE = 0.3  # share of the largest place that one inside the walls needs to be preferred


@dataclass(frozen=True, kw_only=True)
class Ground:
    """A raster over a world.

    Attributes:
        origin: (2,) corner of the first cell in the world frame [m].
        clearance: (nx, ny) distance from each cell to the nearest one with a wall [m].
        is_free: (nx, ny) the cells of one place in which a robot gets everywhere.
    """

    origin: Points
    clearance: NDArray[np.float64]
    is_free: NDArray[np.bool_]

    def centres(self, cells: Cells) -> Points:
        """(..., 2) centres of (..., 2) cells in the world frame [m]."""
        return self.origin + (cells + 0.5) * CELL

    def is_free_between(self, a: Points, b: Points) -> bool:
        """Whether the straight way from one (2,) point to another [m] stays on free cells."""
        cells = ((_along(a, b) - self.origin) / CELL).astype(np.int64)
        return bool(self.is_free[cells[:, 0], cells[:, 1]].all())


def survey(walls: Segments) -> Ground:
    """Rasterise (n, 4) walls [m] and choose the place to drive in: inside the walls if there is room enough."""
    ends = walls.reshape(-1, 2)
    origin = ends.min(axis=0) - _MARGIN
    shape = np.ceil((ends.max(axis=0) + _MARGIN - origin) / CELL).astype(np.int64)
    touched = np.concatenate([_along(segment[:2], segment[2:]) for segment in walls])
    cells = ((touched - origin) / CELL).astype(np.int64)
    has_wall = np.zeros(tuple(shape.tolist()), dtype=np.bool_)
    has_wall[cells[:, 0], cells[:, 1]] = True
    clearance = np.asarray(ndimage.distance_transform_edt(~has_wall), dtype=np.float64) * CELL
    return Ground(origin=origin, clearance=clearance, is_free=_largest_place(clearance > CLEARANCE))


def _along(a: Points, b: Points) -> Points:
    """(n, 2) points from one to another, half a cell apart or less [m]."""
    n = int(2 * float(np.hypot(*(b - a))) / CELL) + 2
    return a + np.linspace(0.0, 1.0, n)[:, None] * (b - a)


def _largest_place(is_free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest connected part that does not touch the border, or the largest of all where that is much larger."""
    places, _ = ndimage.label(is_free)
    sizes = np.bincount(places.ravel())
    sizes[0] = 0
    inside = sizes.copy()
    inside[np.concatenate([places[0], places[-1], places[:, 0], places[:, -1]])] = 0
    chosen = inside.argmax() if inside.max() > _LEAST_INSIDE * sizes.max() else sizes.argmax()
    return np.asarray(places == chosen)
