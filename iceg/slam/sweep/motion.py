"""How the robot moves while a scan is taken, from a trajectory of the middles of the scans."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from graph.arrays import Floats
from graph.se2 import between, logmap
from iceg.slam.recording.intervals import confirmed_intervals


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionWithin:
    """The way through n scans: τ intervals from the middle of a scan, the robot is at exp(velocity τ + change τ² / 2).

    An interval is the usual time from scan to scan. Rows are x [m], y [m] and heading [rad] in the robot's own frame.

    Attributes:
        velocity: (n, 3) per interval.
        change: (n, 3) of the velocity, per interval.
    """

    velocity: Floats
    change: Floats


_OVER_FOUR = (np.array([0.2, 0.3, 0.3, 0.2]), np.array([-0.3, -0.1, 0.1, 0.3]))
"""Velocity and change from four steps, two on either side (Savitzky and Golay 1964, quadratic over five poses). Matches
know the heading to a fraction of what a robot turns from scan to scan, but not so the position, and a robot turns
faster than it gains speed: this takes a third off the error of the speed, and would treble the turn's."""


def motion_within(T_map_robot: Floats, stamps: Floats, unknown: Iterable[int] = ()) -> MotionWithin:
    """The parabola through the poses around each in a trajectory: three for the heading, five for the position.

    Args:
        T_map_robot: (n, 3) at each scan.
        stamps: (n,) of the scans [s]; only tell where scans are missing, as those of many logs jitter.
        unknown: scans the way to which from the one before is not known.

    Returns:
        The motion within each scan, of fewer poses near the ends and next to an unknown step; with one step known, that
        one's velocity without change; zero where neither is.
    """
    n = len(T_map_robot)
    steps = np.zeros((n + 3, 3))  # steps[k + 1] leads to pose k
    twists = logmap(between(T_map_robot[:-1], T_map_robot[1:]))
    lengths = np.sqrt(twists[:, 0] ** 2 + twists[:, 1] ** 2)
    steps[2 : n + 1] = twists / confirmed_intervals(stamps, lengths)[:, None]
    is_known = np.zeros(n + 3, np.bool_)
    is_known[2 : n + 1] = True
    is_known[np.array([*unknown], dtype=np.int64) + 1] = False
    before, after = steps[1:-2], steps[2:-1]
    knows_before, knows_after = is_known[1:-2, None], is_known[2:-1, None]
    only = np.where(knows_before, before, np.where(knows_after, after, 0.0))
    both = knows_before & knows_after
    velocity, change = np.where(both, 0.5 * (before + after), only), np.where(both, after - before, 0.0)
    around = [steps[k : n + k, :2] for k in range(4)]
    all_four = both & is_known[:n, None] & is_known[3:, None]
    for found, weights in zip((velocity, change), _OVER_FOUR, strict=True):
        smooth = sum(weight * step for weight, step in zip(weights, around, strict=True))
        found[:, :2] = np.where(all_four, smooth, found[:, :2])
    return MotionWithin(velocity=velocity, change=change)
