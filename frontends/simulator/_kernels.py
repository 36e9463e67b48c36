"""Compiled ray casting: beams against segments that come and go, and against round legs."""

import math

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled


@compiled
def cast_rays(
    T_world_laser: NDArray[np.float64],
    times: NDArray[np.float64],
    bearings: NDArray[np.float64],
    segments: NDArray[np.float64],
    visible_from: NDArray[np.float64],
    visible_to: NDArray[np.float64],
    range_max: float,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Exact distance along each beam of each scan to the first segment that stands, and which; inf, -1 beyond reach.

    Bearings increase and lie about [-pi, pi]. A beam between the bearings of a segment's two ends may still miss it by
    rounding, so the neighbours are asked too and the signs of two cross products decide.
    """
    n_scans, n_beams, n_segments = len(T_world_laser), len(bearings), len(segments)
    ranges = np.full((n_scans, n_beams), np.inf)
    hits = np.full((n_scans, n_beams), -1, dtype=np.int32)
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
                    hits[i, k] = j
    return ranges, hits


@compiled
def cast_sweeps(
    T_world_laser: NDArray[np.float64],
    T_world_beam: NDArray[np.float64],
    times: NDArray[np.float64],
    bearings: NDArray[np.float64],
    segments: NDArray[np.float64],
    visible_from: NDArray[np.float64],
    visible_to: NDArray[np.float64],
    range_max: float,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """As `cast_rays`, for a laser that moves while it scans: each beam has a pose of its own, (n, n_beams, 3)."""
    n_scans, n_beams, n_segments = len(T_world_laser), len(bearings), len(segments)
    ranges = np.full((n_scans, n_beams), np.inf)
    hits = np.full((n_scans, n_beams), -1, dtype=np.int32)
    for i in range(n_scans):
        x, y, heading = T_world_laser[i]
        c, s = math.cos(heading), math.sin(heading)
        ux, uy = np.cos(T_world_beam[i, :, 2]), np.sin(T_world_beam[i, :, 2])
        moved, turned = 0.0, 0.0
        for k in range(n_beams):
            moved = max(moved, math.hypot(T_world_beam[i, k, 0] - x, T_world_beam[i, k, 1] - y))
            turn = T_world_beam[i, k, 2] - heading - bearings[k]
            turned = max(turned, abs(math.atan2(math.sin(turn), math.cos(turn))))
        reach = range_max + moved
        for j in range(n_segments):
            if not visible_from[j] <= times[i] < visible_to[j]:
                continue
            ax, ay = _to_laser(segments[j, 0] - x, segments[j, 1] - y, c, s)
            bx, by = _to_laser(segments[j, 2] - x, segments[j, 3] - y, c, s)
            if min(ax, bx) > reach or max(ax, bx) < -reach or min(ay, by) > reach or max(ay, by) < -reach:
                continue
            near = _distance(ax, ay, bx, by)
            first, last = 0, n_beams
            if near > 2.0 * moved:
                margin = turned + math.asin(moved / near)
                end_a, end_b = math.atan2(ay, ax), math.atan2(by, bx)
                first, last = _beams_across(bearings, min(end_a, end_b) - margin, max(end_a, end_b) + margin)
            for k in range(first, last):
                dax, day = segments[j, 0] - T_world_beam[i, k, 0], segments[j, 1] - T_world_beam[i, k, 1]
                dbx, dby = segments[j, 2] - T_world_beam[i, k, 0], segments[j, 3] - T_world_beam[i, k, 1]
                side_a = ux[k] * day - uy[k] * dax
                side_b = ux[k] * dby - uy[k] * dbx
                if side_a * side_b > 0.0 or side_a == side_b:
                    continue
                distance = (dax * dby - day * dbx) / (side_b - side_a)
                if 0.0 < distance < ranges[i, k] and distance <= range_max:
                    ranges[i, k] = distance
                    hits[i, k] = j
    return ranges, hits


@compiled
def _distance(ax: float, ay: float, bx: float, by: float) -> float:
    """From the origin to a segment."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    share = 0.0 if length2 == 0.0 else min(1.0, max(0.0, -(ax * dx + ay * dy) / length2))
    return math.hypot(ax + share * dx, ay + share * dy)


@compiled
def cast_on_circles(
    T_world_beam: NDArray[np.float64],
    centres: NDArray[np.float64],
    radius: float,
    range_max: float,
    ranges: NDArray[np.float64],
    hits: NDArray[np.int32],
) -> None:
    """Shorten, in place, each beam that meets a circle before what it met so far; such a beam hits nothing else (-1).

    Every beam has its pose, (n, n_beams, 3); `centres` is (n, m, 2), NaN where nobody stands.
    """
    n_scans, n_beams = ranges.shape
    for i in range(n_scans):
        for k in range(n_beams):
            x, y, heading = T_world_beam[i, k]
            c, s = math.cos(heading), math.sin(heading)
            for j in range(centres.shape[1]):
                along, aside = _to_laser(centres[i, j, 0] - x, centres[i, j, 1] - y, c, s)
                if not (along > radius and abs(aside) <= radius):
                    continue
                distance = along - math.sqrt(radius * radius - aside * aside)
                if distance < ranges[i, k] and distance <= range_max:
                    ranges[i, k] = distance
                    hits[i, k] = -1


@compiled
def _beams_across(bearings: NDArray[np.float64], end_a: float, end_b: float) -> tuple[int, int]:
    """Half-open range of the beams that may hit a segment whose ends have these bearings; all if it is behind."""
    lowest, highest = min(end_a, end_b), max(end_a, end_b)
    astern = math.pi - 0.1
    if highest - lowest > math.pi or lowest < -astern or highest > astern:
        return 0, len(bearings)
    first = int(np.searchsorted(bearings, lowest)) - 1
    last = int(np.searchsorted(bearings, highest)) + 1
    return max(first, 0), min(last, len(bearings))


@compiled
def _to_laser(dx: float, dy: float, c: float, s: float) -> tuple[float, float]:
    return c * dx + s * dy, c * dy - s * dx
