"""Compiled ray casting: beams against segments that come and go."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def cast_rays(
    T_world_laser: NDArray[np.float64],
    times: NDArray[np.float64],
    bearings: NDArray[np.float64],
    segments: NDArray[np.float64],
    visible_from: NDArray[np.float64],
    visible_to: NDArray[np.float64],
    range_max: float,
) -> NDArray[np.float64]:
    """Exact distance along each beam of each scan to the first segment that stands; inf beyond `range_max`.

    Bearings increase and lie about [-pi, pi]. A beam between the bearings of a segment's two ends may still miss it by
    rounding, so the neighbours are asked too and the signs of two cross products decide.
    """
    n_scans, n_beams, n_segments = len(T_world_laser), len(bearings), len(segments)
    ranges = np.full((n_scans, n_beams), np.inf)
    ux, uy = np.cos(bearings), np.sin(bearings)
    for i in range(n_scans):
        x, y, heading = T_world_laser[i]
        c, s = math.cos(heading), math.sin(heading)
        for j in range(n_segments):
            if not visible_from[j] <= times[i] < visible_to[j]:
                continue
            ax, ay = _to_laser(segments[j, 0] - x, segments[j, 1] - y, c, s)
            bx, by = _to_laser(segments[j, 2] - x, segments[j, 3] - y, c, s)
            if min(ax, bx) > range_max or max(ax, bx) < -range_max:
                continue
            if min(ay, by) > range_max or max(ay, by) < -range_max:
                continue
            moment = ax * by - ay * bx
            first, last = _beams_across(bearings, math.atan2(ay, ax), math.atan2(by, bx))
            for k in range(first, last):
                side_a = ux[k] * ay - uy[k] * ax
                side_b = ux[k] * by - uy[k] * bx
                if side_a * side_b > 0.0 or side_a == side_b:
                    continue
                distance = moment / (side_b - side_a)
                if 0.0 < distance < ranges[i, k] and distance <= range_max:
                    ranges[i, k] = distance
    return ranges


@njit(cache=True)
def _beams_across(bearings: NDArray[np.float64], end_a: float, end_b: float) -> tuple[int, int]:
    """Half-open range of the beams that may hit a segment whose ends have these bearings; all if it is behind."""
    lowest, highest = min(end_a, end_b), max(end_a, end_b)
    astern = math.pi - 0.1
    if highest - lowest > math.pi or lowest < -astern or highest > astern:
        return 0, len(bearings)
    first = int(np.searchsorted(bearings, lowest)) - 1
    last = int(np.searchsorted(bearings, highest)) + 1
    return max(first, 0), min(last, len(bearings))


@njit(cache=True)
def _to_laser(dx: float, dy: float, c: float, s: float) -> tuple[float, float]:
    return c * dx + s * dy, c * dy - s * dx
