"""Which pairs of points count: places of an outline nearest to the points of a scan, and rules against false ones.

A pair is left out where the nearest place is an end of what the reference saw: beyond it lies ground it did not see
(Turk and Levoy 1994; Rusinkiewicz and Levoy 2001). Of the others the farthest are trimmed.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.matchers._fit_kernels import move
from frontends.matchers._outline_kernels import Outline, closest, matching_range
from graph._sort_kernels import _smallest
from graph.compiled import compiled, compiled_for_both


class Pairs(NamedTuple):
    """Points of a scan and the places of the reference they belong to.

    Attributes:
        moved: (n, 2) the points in the frame of the reference [m].
        targets: (n, 2) their places [m].
        normals: (n, 2) unit normals of the surface there; 0 at a lone point.
        squares: (n,) squared distances in the matcher's metric [m²], inf where there is no pair.
        indices: (n,) the piece of the outline each place lies on, -1 where there is none.
        kept: (n,) which pairs count.
    """

    moved: NDArray[np.float64]
    targets: NDArray[np.float64]
    normals: NDArray[np.float64]
    squares: NDArray[np.float64]
    indices: NDArray[np.int64]
    kept: NDArray[np.bool_]


class Trimming(NamedTuple):
    """Which pairs are near enough.

    Attributes:
        max_distance: farthest pair [m].
        share: of the pairs that is kept, the nearest ones …
        order: … and of them those no farther than `factor` times …
        factor: … the quantile of this order (Censi 2008).
        least_end: pairs at this kind of end of the outline or a higher one are left out; none from 3 on.
    """

    max_distance: float
    share: float
    order: float
    factor: float
    least_end: int


@compiled_for_both
def no_pairs(n: int) -> Pairs:
    """Room for the pairs of n points."""
    return Pairs(
        np.empty((n, 2)), np.empty((n, 2)), np.zeros((n, 2)), np.empty(n), np.full(n, -1), np.zeros(n, np.bool_)
    )


@compiled_for_both
def associate(
    outline: Outline,
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    length2: float,
    window: float,
    trimming: Trimming,
    pairs: Pairs,
) -> None:
    """Nearest place of every moved point. The indices of the last time bound the search and change nothing else."""
    move(points, pose, pairs.moved)
    limit2 = trimming.max_distance**2
    for i in range(len(points)):
        px, py = pairs.moved[i]
        x, y, d2, j = closest(px, py, outline, length2, window, limit2, pairs.indices[i])
        pairs.indices[i] = j
        pairs.targets[i, 0], pairs.targets[i, 1] = x, y
        pairs.normals[i] = 0.0
        pairs.squares[i] = math.inf if j < 0 or _end_at(outline, j, x, y) >= trimming.least_end else d2
        if j < 0 or not outline.linked[j]:
            continue
        after = j + 1 if j + 1 < len(outline.xy) else 0
        ex, ey = outline.xy[after, 0] - outline.xy[j, 0], outline.xy[after, 1] - outline.xy[j, 1]
        length = math.hypot(ex, ey)
        if length > 0.0:
            pairs.normals[i, 0], pairs.normals[i, 1] = -ey / length, ex / length


@compiled
def _end_at(outline: Outline, j: int, x: float, y: float) -> int:
    """What kind of end a place on piece j is; 0 if it is none."""
    after = j + 1 if j + 1 < len(outline.xy) else 0
    for point in (j, after):
        if abs(x - outline.xy[point, 0]) + abs(y - outline.xy[point, 1]) < 1e-9:
            return int(outline.ends[point])
    return 0


@compiled_for_both
def associate_range(
    outline: Outline, ranges: NDArray[np.float64], window: float, max_distance: float, pairs: Pairs
) -> None:
    """Place at matching range of every moved point; the difference in range must stay small."""
    for i in range(len(pairs.moved)):
        px, py = pairs.moved[i]
        x, y, found = matching_range(px, py, outline, ranges, window)
        pairs.targets[i, 0], pairs.targets[i, 1] = x, y
        gap = math.hypot(x, y) - math.hypot(px, py)
        pairs.squares[i] = math.inf
        if found and abs(gap) <= max_distance:
            pairs.squares[i] = (x - px) ** 2 + (y - py) ** 2


@compiled_for_both
def measure_to_lines(pairs: Pairs) -> None:
    """Take the distances to the lines through the surfaces instead of those to the nearest places."""
    for i in range(len(pairs.squares)):
        nx, ny = pairs.normals[i]
        if nx == 0.0 and ny == 0.0:
            pairs.squares[i] = math.inf
        elif math.isfinite(pairs.squares[i]):
            dx, dy = pairs.moved[i, 0] - pairs.targets[i, 0], pairs.moved[i, 1] - pairs.targets[i, 1]
            pairs.squares[i] = (nx * dx + ny * dy) ** 2


@compiled_for_both
def drop_doubles(n: int, pairs: Pairs) -> None:
    """Of the points that share a piece of the outline, one of n, only the one with the least error stays."""
    owner = np.full(n, -1, np.int64)
    for i in range(len(pairs.squares)):
        if math.isinf(pairs.squares[i]):
            continue
        j = pairs.indices[i]
        if owner[j] < 0:
            owner[j] = i
        elif pairs.squares[i] < pairs.squares[owner[j]]:
            pairs.squares[owner[j]] = math.inf
            owner[j] = i
        else:
            pairs.squares[i] = math.inf


@compiled_for_both
def drop_hidden(pairs: Pairs) -> None:
    """Points that fall behind an earlier one in bearing order cannot have been seen from the reference."""
    moved = pairs.moved
    turned, farthest, last = 0.0, -math.inf, math.atan2(moved[0, 1], moved[0, 0])
    for i in range(len(moved)):
        bearing = math.atan2(moved[i, 1], moved[i, 0])
        step = (bearing - last + math.pi) % (2.0 * math.pi) - math.pi
        turned += step
        last = bearing
        if turned < farthest:
            pairs.squares[i] = math.inf
        else:
            farthest = turned


@compiled_for_both
def trim(trimming: Trimming, pairs: Pairs) -> int:
    """Mark the pairs that are near enough; return how many."""
    finite = pairs.squares[np.isfinite(pairs.squares)]
    pairs.kept[:] = False
    if len(finite) == 0:
        return 0
    last = len(finite) - 1
    fixed = min(last, math.ceil(trimming.share * len(finite)) - 1)
    middle = min(last, int(trimming.order * len(finite)))
    limit = _smallest(finite, fixed)
    if math.isfinite(trimming.factor):
        limit = min(limit, trimming.factor**2 * _smallest(finite, middle))
    count = 0
    for i in range(len(pairs.squares)):
        pairs.kept[i] = pairs.squares[i] <= limit
        count += pairs.kept[i]
    return count


@compiled
def agreement(
    outline: Outline, points: NDArray[np.float64], pose: NDArray[np.float64], inlier: float, known: float
) -> tuple[int, int]:
    """How many points lie within `inlier` of the reference's surface, and within `known` of it."""
    moved = np.empty_like(points)
    move(points, pose, moved)
    inliers, overlapping = 0, 0
    for i in range(len(moved)):
        _, _, d2, j = closest(moved[i, 0], moved[i, 1], outline, math.inf, math.pi, known * known, -1)
        if j >= 0:
            overlapping += 1
            inliers += d2 <= inlier * inlier
    return inliers, overlapping


@compiled
def closeness(outline: Outline, points: NDArray[np.float64], pose: NDArray[np.float64], reach: float) -> float:
    """Mean of 1 − d²/reach², 0 from `reach` on, d to the reference's surface: in [0, 1].

    Along a corridor the number of points that agree tells little, for a wall agrees with itself; this tells more.
    """
    moved = np.empty_like(points)
    move(points, pose, moved)
    total = 0.0
    for i in range(len(moved)):
        _, _, d2, j = closest(moved[i, 0], moved[i, 1], outline, math.inf, math.pi, reach * reach, -1)
        if j >= 0:
            total += 1.0 - d2 / (reach * reach)
    return total / max(len(moved), 1)
