"""Nearest places of a reference whose points are in bearing order, compiled.

A closest point is searched outwards from the bearing of the query: a point δ further round is at least r·sin δ away,
which ends the search exactly, after a handful of candidates.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both


class Outline(NamedTuple):
    """What a scan shows of the surfaces around it: its points, and which neighbours a straight piece joins.

    Attributes:
        xy: (n, 2) end points [m].
        bearings: (n,) increasing [rad].
        linked: (n,) whether point i and the next one (the first after the last) are joined.
        ends: (n,) where unseen ground begins: 2 at the first and last point, 1 at other ends of joined rows, else 0.
    """

    xy: NDArray[np.float64]
    bearings: NDArray[np.float64]
    linked: NDArray[np.bool_]
    ends: NDArray[np.int8]


@compiled_for_both
def closest(
    x: float, y: float, outline: Outline, length2: float, window: float, limit2: float, hint: int
) -> tuple[float, float, float, int]:
    """Closest point of the reference to (x, y): target x, y, squared distance and index; index -1 if there is none.

    The hint is where it was last time, -1 if unknown: it bounds the search and changes nothing else.

    Distances are in the metric d² = |δ|² − (δ × p)²/(|p|² + `length2`), Euclidean for an infinite length. Between
    linked neighbours the whole segment counts, elsewhere the points only.
    """
    xy, bearings, linked, _ = outline
    n = len(xy)
    r2 = x * x + y * y
    reach = math.sqrt(r2) if math.isinf(length2) else math.sqrt(r2 * length2 / (r2 + length2))
    bearing = _unwrapped(math.atan2(y, x), bearings[0])
    start = _lower_bound(bearings, bearing)
    best2, found, fx, fy = limit2, -1, 0.0, 0.0
    if hint >= 0 and math.pi - abs(abs(bearings[hint] - bearing) - math.pi) <= window:
        qx, qy, d2 = _nearest_on(x, y, r2, xy, hint, linked[hint], length2)
        if d2 < best2:
            best2, found, fx, fy = d2, hint, qx, qy
    limit = min(window, _farthest_turn(reach, best2))
    for k in range(n):
        j, delta = start + k, -bearing
        if j >= n:
            j, delta = j - n, delta + 2.0 * math.pi
        if delta + bearings[j] > limit:
            break
        qx, qy, d2 = _nearest_on(x, y, r2, xy, j, linked[j], length2)
        if d2 < best2:
            best2, found, fx, fy = d2, j, qx, qy
            limit = min(window, _farthest_turn(reach, best2))
    for k in range(n):
        j, delta = start - 1 - k, bearing
        if j < 0:
            j, delta = j + n, delta + 2.0 * math.pi
        # A linked piece reaches from j up to the next point, which is nearer by one beam.
        nearest = j + 1 if linked[j] and j + 1 < n else j
        if delta - bearings[nearest] > limit and not (linked[j] and j + 1 == n):
            break
        qx, qy, d2 = _nearest_on(x, y, r2, xy, j, linked[j], length2)
        if d2 < best2:
            best2, found, fx, fy = d2, j, qx, qy
            limit = min(window, _farthest_turn(reach, best2))
    return fx, fy, best2, found


@compiled_for_both
def matching_range(
    x: float, y: float, outline: Outline, ranges: NDArray[np.float64], window: float
) -> tuple[float, float, bool]:
    """Point of the reference at the same range as (x, y) whose bearing is nearest, within ±`window`.

    Where no linked pair of neighbours spans the range, the point of the least difference in range.
    """
    xy, bearings, linked, _ = outline
    n = len(xy)
    r = math.hypot(x, y)
    bearing = _unwrapped(math.atan2(y, x), bearings[0])
    start = _lower_bound(bearings, bearing)
    best, crossing, least, found = window, False, math.inf, False
    qx, qy = 0.0, 0.0
    for side in range(2):
        for k in range(n):
            j, delta = (start + k, -bearing) if side == 0 else (start - 1 - k, -bearing)
            if j >= n:
                j, delta = j - n, delta + 2.0 * math.pi
            elif j < 0:
                j, delta = j + n, delta - 2.0 * math.pi
            delta += bearings[j]
            after, width = j + 1, 0.0
            if j + 1 < n:
                width = bearings[j + 1] - bearings[j]
            elif linked[j]:
                after, width = 0, bearings[0] - bearings[j] + 2.0 * math.pi
            if (delta if side == 0 else -delta - width) > best:
                break
            gap = abs(ranges[j] - r)
            if not crossing and gap < least and abs(delta) <= window:
                least, found, qx, qy = gap, True, xy[j, 0], xy[j, 1]
            if linked[j] and (ranges[j] - r) * (ranges[after] - r) <= 0.0:
                share = 0.0 if ranges[after] == ranges[j] else (r - ranges[j]) / (ranges[after] - ranges[j])
                turn = abs(delta + share * width)
                if turn <= best:
                    best, crossing, found = turn, True, True
                    qx = xy[j, 0] + share * (xy[after, 0] - xy[j, 0])
                    qy = xy[j, 1] + share * (xy[after, 1] - xy[j, 1])
    return qx, qy, found


@compiled
def _lower_bound(values: NDArray[np.float64], value: float) -> int:
    low, high = 0, len(values)
    while low < high:
        middle = (low + high) // 2
        if values[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@compiled
def _unwrapped(angle: float, base: float) -> float:
    """The same angle in [base, base + 2π)."""
    while angle < base:
        angle += 2.0 * math.pi
    while angle >= base + 2.0 * math.pi:
        angle -= 2.0 * math.pi
    return angle


@compiled
def _farthest_turn(reach: float, best2: float) -> float:
    """How far round something may lie and still be as near as √best2."""
    if best2 >= reach * reach:
        return math.pi
    return math.asin(math.sqrt(best2) / reach)


@compiled
def _nearest_on(
    x: float, y: float, r2: float, xy: NDArray[np.float64], j: int, whole: bool, length2: float
) -> tuple[float, float, float]:
    """Nearest to (x, y) of point j or, if `whole`, of the segment from it to the next: x, y, squared distance."""
    k = 1.0 / (r2 + length2)
    ax, ay = xy[j, 0] - x, xy[j, 1] - y
    turn = ax * y - ay * x
    if not whole:
        return xy[j, 0], xy[j, 1], ax * ax + ay * ay - k * turn * turn
    after = j + 1 if j + 1 < len(xy) else 0
    ex, ey = xy[after, 0] - xy[j, 0], xy[after, 1] - xy[j, 1]
    e_turn = ex * y - ey * x
    quadratic = ex * ex + ey * ey - k * e_turn * e_turn
    linear = ax * ex + ay * ey - k * turn * e_turn
    share = 0.0 if quadratic <= 0.0 else min(1.0, max(0.0, -linear / quadratic))
    ax, ay, turn = ax + share * ex, ay + share * ey, turn + share * e_turn
    return x + ax, y + ay, ax * ax + ay * ay - k * turn * turn
