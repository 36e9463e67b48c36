"""Compiled loops of a local map: its surfels and the fields of nearest surfels.

A *surfel* is the mean of the reference points that fall into one small cell and face the same way, with their mean
normal. A *field* stores for every cell of a regular grid which surfel is nearest, so that a correspondence costs one
look-up.
"""

from math import ceil, cos, exp, floor, hypot, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

_SAME_FACING = 0.6
"""A point joins the surfel of its cell whose mean normal and its own have at least this cosine."""
_REACH = 2.5
"""Surfels so many widths away are sharpened by each other."""
_SHARP_ROUNDS = 3
_FEW_BEYOND = 0.25
"""Share of the points of a scan that the usual reach may leave out."""
_CROWDED = 0.3
"""Squared distance, in cells, within which a surfel makes a newer one needless."""


@compiled
def add_points(
    points: F64,
    normals: F64,
    starts: I64,
    poses: F64,
    width: float,
    table: I32,
    sums: F64,
    surfels: F64,
    n_surfels: int,
    origin: F64,
    cell: float,
    radius: float,
    nearest: I32,
    distance2: F32,
) -> int:
    """Add the points of scans to the surfels, scan after scan, and note the new surfels in their field.

    Args:
        points: (n, 2) in the frames of their scans [m].
        normals: (n, 2); points without a normal are left out.
        starts: (m + 1,) scan k has the points from starts[k] to starts[k + 1].
        poses: (m, 3) T_ref_robot of each scan.
        width: surfels are sharpened by neighbours weighed by a Gaussian of this width [m], see `_sharpen`; 0 for none.
        table: (ny, nx, 2) surfels of each cell, one per facing, -1 where none; extended in place.
        sums: (capacity, 5) Σx, Σy, Σnx, Σny, count; extended in place.
        surfels: (capacity, 4) mean x, y and unit normal; renewed.
        n_surfels: how many there are so far.
        origin: (2,) lower left corner of the table, and of the field [m].
        cell: width of their cells [m].
        radius: see `stamp_field`, as …
        nearest: …
        distance2: …

    Returns:
        The new number of surfels.
    """
    n = _add_surfels(points, normals, starts, poses, origin, cell, table, sums, n_surfels)
    _average(sums[:n], surfels)
    if width > 0.0:
        _sharpen(sums[:n], table, origin, cell, width, surfels[:n])
    stamp_field(surfels, n_surfels, n, origin, cell, radius, nearest, distance2, False)
    return n


@compiled
def _add_surfels(
    points: F64, normals: F64, starts: I64, poses: F64, origin: F64, cell: float, table: I32, sums: F64, n_surfels: int
) -> int:
    """Add points to the sums of their surfels, see `add_points`; the new number of these."""
    ny, nx = table.shape[0], table.shape[1]
    for scan in range(len(poses)):
        px, py, c, s = poses[scan, 0], poses[scan, 1], cos(poses[scan, 2]), sin(poses[scan, 2])
        for i in range(starts[scan], starts[scan + 1]):
            if normals[i, 0] == 0.0 and normals[i, 1] == 0.0:
                continue
            x = px + c * points[i, 0] - s * points[i, 1]
            y = py + s * points[i, 0] + c * points[i, 1]
            u, v = floor((x - origin[0]) / cell), floor((y - origin[1]) / cell)
            if u < 0 or v < 0 or u >= nx or v >= ny:
                continue
            mx, my = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
            for slot in range(2):
                k = table[v, u, slot]
                if k < 0:
                    k = n_surfels
                    n_surfels += 1
                    table[v, u, slot] = k
                    sums[k] = 0.0
                elif sums[k, 2] * mx + sums[k, 3] * my <= _SAME_FACING * sums[k, 4]:
                    continue
                sums[k, 0] += x
                sums[k, 1] += y
                sums[k, 2] += mx
                sums[k, 3] += my
                sums[k, 4] += 1.0
                break
    return n_surfels


@compiled
def _average(sums: F64, surfels: F64) -> None:
    """Mean position and unit normal of each surfel, see `add_points`."""
    for k in range(len(sums)):
        n, norm = sums[k, 4], hypot(sums[k, 2], sums[k, 3])
        surfels[k, 0], surfels[k, 1] = sums[k, 0] / n, sums[k, 1] / n
        surfels[k, 2], surfels[k, 3] = sums[k, 2] / norm, sums[k, 3] / norm


@compiled
def _sharpen(sums: F64, table: I32, origin: F64, cell: float, width: float, surfels: F64) -> None:
    """Move surfels across their wall to where most points lie: mean shift (Comaniciu and Meer 2002), along the normal.

    Noise spreads the points of one wall over several cells, each of which has a surfel of its own. What is nearest to a
    point would then hardly ever be the wall.

    Args:
        sums: (n, 5) see `add_points`, as …
        table: …
        origin: …
        cell: …
        width: of the Gaussian that weighs neighbours [m].
        surfels: (n, 4) mean x, y and unit normal of each; sharpened in place.
    """
    span = ceil(_REACH * width / cell)
    shifts = np.empty((len(surfels), 4))
    for _ in range(_SHARP_ROUNDS):
        for k in range(len(surfels)):
            _shift(k, sums, table, origin, cell, width, span, surfels, shifts[k])
        for k in range(len(surfels)):
            for a in range(4):
                surfels[k, a] = shifts[k, a]


@compiled
def _shift(
    k: int, sums: F64, table: I32, origin: F64, cell: float, width: float, span: int, surfels: F64, out: F64
) -> None:
    """One round of `_sharpen` for one surfel: its new row."""
    x, y, nx, ny = surfels[k, 0], surfels[k, 1], surfels[k, 2], surfels[k, 3]
    # Its own cell, whence it may have moved.
    u = floor((sums[k, 0] / sums[k, 4] - origin[0]) / cell)
    v = floor((sums[k, 1] / sums[k, 4] - origin[1]) / cell)
    total, across, mx, my = 0.0, 0.0, 0.0, 0.0
    for b in range(max(0, v - span), min(table.shape[0], v + span + 1)):
        for a in range(max(0, u - span), min(table.shape[1], u + span + 1)):
            for slot in range(2):
                j = table[b, a, slot]
                if j < 0 or nx * surfels[j, 2] + ny * surfels[j, 3] < _SAME_FACING:
                    continue
                dx, dy = surfels[j, 0] - x, surfels[j, 1] - y
                weight = sums[j, 4] * exp(-0.5 * (dx * dx + dy * dy) / (width * width))
                total += weight
                across += weight * (nx * dx + ny * dy)
                mx += weight * surfels[j, 2]
                my += weight * surfels[j, 3]
    norm = hypot(mx, my)
    out[0], out[1] = x + across / total * nx, y + across / total * ny
    out[2], out[3] = mx / norm, my / norm


@compiled
def box_around(points: F64, starts: I64, poses: F64, usual: float, margin: float, lower: F64, upper: F64) -> None:
    """Smallest box on whole metres around the points of scans that lie within reach of the last of them.

    Args:
        points: (n, 2) in the frames of their scans [m].
        starts: (m + 1,) scan k has the points from starts[k] to starts[k + 1].
        poses: (m, 3) T_ref_robot of each scan.
        usual: the least reach [m], see `_reach`.
        margin: added on every side [m].
        lower: (2,) output …
        upper: … and (2,) the other corner [m].
    """
    last = len(poses) - 1
    x0, y0, reach = poses[last, 0], poses[last, 1], _reach(points[starts[last] :], usual)
    left, right, bottom, top = x0, x0, y0, y0
    for scan in range(len(poses)):
        px, py, c, s = poses[scan, 0], poses[scan, 1], cos(poses[scan, 2]), sin(poses[scan, 2])
        for i in range(starts[scan], starts[scan + 1]):
            x = px + c * points[i, 0] - s * points[i, 1]
            y = py + s * points[i, 0] + c * points[i, 1]
            left, right = min(left, x), max(right, x)
            bottom, top = min(bottom, y), max(top, y)
    lower[0], lower[1] = floor(max(left, x0 - reach) - margin), floor(max(bottom, y0 - reach) - margin)
    upper[0], upper[1] = ceil(min(right, x0 + reach) + margin), ceil(min(top, y0 + reach) + margin)


@compiled
def _reach(points: F64, usual: float) -> float:
    """How far a local map reaches around a scan: where the usual reach leaves out too much, as far as the scan sees."""
    beyond, farthest2 = 0, 0.0
    for i in range(len(points)):
        square = points[i, 0] * points[i, 0] + points[i, 1] * points[i, 1]
        beyond += 1 if square > usual * usual else 0
        farthest2 = max(farthest2, square)
    return sqrt(farthest2) if beyond > _FEW_BEYOND * len(points) else usual


@compiled_for_both
def stamp_field(
    surfels: F64,
    start: int,
    end: int,
    origin: F64,
    cell: float,
    radius: float,
    nearest: I32,
    distance2: F32,
    thin: bool,
) -> None:
    """Write into every cell within a radius of surfels[start:end] the index of the nearest one.

    Args:
        surfels: (n, 4) x, y and unit normal.
        start: first new one.
        end: one past the last.
        origin: (2,) lower left corner of the field [m].
        cell: width of its cells [m].
        radius: how far a surfel is noted [m].
        nearest: (ny, nx) changed in place.
        distance2: (ny, nx) squared distance from the centre of the cell [m²], radius² where none is near; changed in
            place.
        thin: leave out a surfel whose own cell already holds one closer than a cell's width.
    """
    ny, nx = nearest.shape
    span = int(radius / cell + 0.5)
    cell2 = np.float32(cell * cell)
    for k in range(start, end):
        x = (surfels[k, 0] - origin[0]) / cell - 0.5
        y = (surfels[k, 1] - origin[1]) / cell - 0.5
        u, v = floor(x + 0.5), floor(y + 0.5)
        if u < 0 or v < 0 or u >= nx or v >= ny:
            continue
        if thin and distance2[v, u] < _CROWDED * cell2:
            continue
        name = np.int32(k)
        first, last = max(0, u - span), min(nx, u + span + 1)
        dx = np.float32(first - x)
        for b in range(max(0, v - span), min(ny, v + span + 1)):
            # A row at a time and without branches: the compiler takes several cells at once. A cell of the square
            # beyond the radius holds a smaller distance already.
            dy2 = np.float32((b - y) * (b - y))
            distances, names = distance2[b, first:last], nearest[b, first:last]
            for a in range(distances.size):
                along = dx + np.float32(a)
                d2 = (along * along + dy2) * cell2
                is_nearer = d2 < distances[a]
                distances[a] = d2 if is_nearer else distances[a]
                names[a] = name if is_nearer else names[a]
