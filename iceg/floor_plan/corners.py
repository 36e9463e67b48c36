"""Walls led to the corners where their lines meet."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iceg.floor_plan.config import FloorPlanConfig
from iceg.floor_plan.wall_lines import StraightWall

End = tuple[int, int]
"""A wall's number, and 0 or 1 for its first or second end."""


def with_corners(walls: Sequence[StraightWall], config: FloorPlanConfig) -> list[StraightWall]:
    """Move each end that nearly meets another wall to the place where their lines meet.

    Two ends that nearly meet become one corner, or one bend where the wall goes on; an end near the middle of another
    wall ends on it.

    Args:
        walls: straight walls.
        config: how near that is.
    """
    ends = np.array([wall.ends for wall in walls]).reshape(-1, 2, 2)
    settled: dict[End, NDArray[np.float64]] = {}
    for _, place, moved in sorted(_meetings(ends, config), key=lambda meeting: (meeting[0], meeting[2])):
        if not any(end in settled for end in moved):
            settled.update(dict.fromkeys(moved, place))
    moved_ends = ends.copy()
    for (wall, side), place in settled.items():
        moved_ends[wall, side] = place
    forwards = ((moved_ends[:, 1] - moved_ends[:, 0]) * (ends[:, 1] - ends[:, 0])).sum(axis=1) > 0.0
    return [
        replace(wall, ends=moved_ends[index] if forwards[index] else ends[index]) for index, wall in enumerate(walls)
    ]


def _meetings(
    ends: NDArray[np.float64], config: FloorPlanConfig
) -> list[tuple[float, NDArray[np.float64], tuple[End, ...]]]:
    """Each place where the line of an end meets another wall: how far ends would move, where, and which ends."""
    meetings = _bends(ends, config)
    vectors = ends[:, 1] - ends[:, 0]
    lengths = np.hypot(vectors[:, 0], vectors[:, 1])
    units = vectors / lengths[:, None]
    for wall in range(len(ends)):
        crosses = units[wall, 0] * units[:, 1] - units[wall, 1] * units[:, 0]
        turned = np.abs(crosses) >= math.sin(config.least_corner)
        for side in (0, 1):
            end = ends[wall, side]
            apart = ends[:, 0] - end
            safe = np.where(turned, crosses, 1.0)
            ahead = (apart[:, 0] * units[:, 1] - apart[:, 1] * units[:, 0]) / safe
            along = (apart[:, 0] * units[wall, 1] - apart[:, 1] * units[wall, 0]) / safe
            near = turned & (np.abs(ahead) <= config.corner_reach)
            near &= (along >= -config.corner_reach) & (along <= lengths + config.corner_reach)
            for other in np.flatnonzero(near).tolist():
                place = end + ahead[other] * units[wall]
                meetings.append(_meeting((wall, side), other, place, float(ahead[other]), ends, config))
    return meetings


def _bends(
    ends: NDArray[np.float64], config: FloorPlanConfig
) -> list[tuple[float, NDArray[np.float64], tuple[End, ...]]]:
    """Where a wall goes on in nearly the same direction, as round walls do: halfway between both ends."""
    meetings: list[tuple[float, NDArray[np.float64], tuple[End, ...]]] = []
    units = ends[:, 1] - ends[:, 0]
    units = units / np.hypot(units[:, 0], units[:, 1])[:, None]
    for wall in range(len(ends)):
        gaps = ends[:, 0] - ends[wall, 1]
        distances = np.hypot(gaps[:, 0], gaps[:, 1])
        sideways = np.abs(units[wall, 0] * gaps[:, 1] - units[wall, 1] * gaps[:, 0])
        straight = (units * units[wall]).sum(axis=1) > math.cos(config.least_corner)
        near = straight & (distances <= config.corner_reach) & (sideways <= 2.0 * config.off_line)
        near[wall] = False
        for other in np.flatnonzero(near).tolist():
            place = 0.5 * (ends[wall, 1] + ends[other, 0])
            meetings.append((float(distances[other]), place, ((wall, 1), (other, 0))))
    return meetings


def _meeting(
    end: End, other: int, place: NDArray[np.float64], ahead: float, ends: NDArray[np.float64], config: FloorPlanConfig
) -> tuple[float, NDArray[np.float64], tuple[End, ...]]:
    """A corner where the other wall ends nearby, else an end on that wall."""
    distances = [math.dist(place, ends[other, side]) for side in (0, 1)]
    side = int(distances[1] < distances[0])
    if distances[side] <= config.corner_reach:
        first, second = sorted([end, (other, side)])
        return abs(ahead) + distances[side], place, (first, second)
    return abs(ahead), place, (end,)
