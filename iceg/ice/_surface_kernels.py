"""Compiled loops from points to the surfaces they lie on, and to the moments of their neighbourhoods there.

They are made stage by stage, for all points together: in loops without branches, over columns, the compiler takes eight
points at once.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled
from iceg.ice._noise_kernels import RangeNoise, _beyond

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
Bool = NDArray[np.bool_]

# A surface ends where neighbouring points are farther apart than the jump plus this many beam spacings, and at most so
# far, however many beams between them did not return: the ends of what a laser sees on either side are no wall ahead.
_SPACINGS = 3.0
_WIDEST_GAP = 1.0
_JUMP_SIGMAS2 = 25.0
"""Neighbouring points of one surface may lie farther apart by so many of the ranges' variances …"""
_REACH_SIGMAS2 = 16.0
"""… and the neighbourhood that gives a normal reaches farther by as many: the normal of a wall 4 σ to either side, seen
by ten beams, is known to 0.15 rad."""
_MOST_NEIGHBOURS = 12
"""Most neighbours on either side that give a point its normal; more as it reaches farther for the noise."""


class Surfaces(NamedTuple):
    """Runs of points without a jump.

    Attributes:
        begin: (n,) first point of the surface that each point lies on.
        end: (n,) last one.
        ends: (n,) whether a surface ends before each point.
        sums: (n + 1, 5) of x, y, xx, xy, yy relative to the laser, up to each point: the moments of any stretch are two
            look-ups.
        noise: (n,) variance of the range of each beyond what is allowed for [m²].
    """

    begin: I32
    end: I32
    ends: Bool
    sums: F64
    noise: F64


class Moments(NamedTuple):
    """(n,) each: number of points around each point, and their sums of x, y, xx, xy, yy; worked on in place.

    And the variance of its range beyond what is allowed for [m²].
    """

    n: F64
    x: F64
    y: F64
    xx: F64
    xy: F64
    yy: F64
    noise: F64


@compiled
def _room_for_surfaces(n: int) -> Surfaces:
    return Surfaces(
        np.empty(n, np.int32), np.empty(n, np.int32), np.zeros(n, np.bool_), np.empty((n + 1, 5)), np.empty(n)
    )


@compiled
def _room_for_moments(n: int) -> Moments:
    return Moments(np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))


@compiled
def _surfaces(
    points: F64, beams: I32, origin: F64, resolution: float, jump: float, noise: RangeNoise, surfaces: Surfaces
) -> None:
    """Find where surfaces end, and sum up their points."""
    x0, y0, ends = origin[0], origin[1], surfaces.ends
    for i in range(len(points)):
        x, y = points[i, 0] - x0, points[i, 1] - y0
        surfaces.noise[i] = _beyond(x * x + y * y, noise)
    for i in range(1, len(points)):
        x, y = points[i, 0] - x0, points[i, 1] - y0
        spacing = resolution * sqrt(x * x + y * y) * (beams[i] - beams[i - 1])
        gap = min(_WIDEST_GAP, jump + _SPACINGS * spacing)
        dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        ends[i] = dx * dx + dy * dy > gap * gap + _JUMP_SIGMAS2 * max(surfaces.noise[i], surfaces.noise[i - 1])
    surfaces.sums[0] = 0.0
    sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0
    start = 0
    for i in range(len(points)):
        x, y = points[i, 0] - x0, points[i, 1] - y0
        sx, sy, sxx, sxy, syy = sx + x, sy + y, sxx + x * x, sxy + x * y, syy + y * y
        row = surfaces.sums[i + 1]
        row[0], row[1], row[2], row[3], row[4] = sx, sy, sxx, sxy, syy
        if i > 0 and ends[i]:
            surfaces.end[start:i] = i - 1
            start = i
        surfaces.begin[i] = start
    surfaces.end[start : len(points)] = len(points) - 1


@compiled
def _neighbourhoods(points: F64, surfaces: Surfaces, reach2: float, before: F64, after: F64) -> None:
    """How many points before and after each are its neighbours: of its surface, to the first one beyond the reach.

    Those next to it count however far they are, and more than some do not: see `_MOST_NEIGHBOURS`.
    """
    n, widest = len(points), 0
    x, y, wide2, squares = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        x[i], y[i] = points[i, 0], points[i, 1]
        wide2[i] = reach2 + _REACH_SIGMAS2 * surfaces.noise[i]
        most = int(_MOST_NEIGHBOURS * sqrt(wide2[i] / reach2))
        before[i], after[i] = min(most, i - surfaces.begin[i]), min(most, surfaces.end[i] - i)
        widest = max(widest, most)
    for away in range(2, min(widest + 1, n)):
        _distances2(x[:-away], y[:-away], x[away:], y[away:], squares)
        _end_at(squares, wide2[:-away], float(away), after)
        _end_at(squares, wide2[away:], float(away), before[away:])


@compiled
def _distances2(x: F64, y: F64, u: F64, v: F64, squares: F64) -> None:
    """Squared distances of points (x, y) from others (u, v)."""
    for i in range(len(x)):
        dx, dy = u[i] - x[i], v[i] - y[i]
        squares[i] = dx * dx + dy * dy


@compiled
def _end_at(squares: F64, wide2: F64, away: float, steps: F64) -> None:
    """No more steps than up to the neighbour so many away where that one lies beyond the reach."""
    for i in range(len(wide2)):
        steps[i] = min(steps[i], away if squares[i] >= wide2[i] else np.inf)


@compiled
def _sum_up(surfaces: Surfaces, before: F64, after: F64, first: int, every: int, n: int, moments: Moments) -> None:
    """Moments of n neighbourhoods, so many points before and after each: the first, and one in so many after it."""
    sums = surfaces.sums
    for k in range(n):
        i = first + k * every
        a, b = i - int(before[i]), i + int(after[i])
        moments.noise[k] = surfaces.noise[i]
        begin, end = sums[a], sums[b + 1]
        moments.n[k] = b + 1 - a
        moments.x[k], moments.y[k] = end[0] - begin[0], end[1] - begin[1]
        moments.xx[k], moments.xy[k], moments.yy[k] = end[2] - begin[2], end[3] - begin[3], end[4] - begin[4]
