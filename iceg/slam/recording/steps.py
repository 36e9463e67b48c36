"""Steps of the odometry: which move at all, which no robot made, as where it was set anew, and the way they make up."""

import numpy as np

from graph.arrays import Bools, Floats
from graph.elementary import cos_sin
from graph.se2 import between, wrap_angle
from iceg.slam.calibration_config import SuddenStepConfig
from iceg.slam.recording.intervals import waits

_STILL = 1e-9
"""A step shorter than this is none [m, rad]: the same reading again."""


def is_moving(odometry: Floats) -> Bools:
    """(n - 1,) which steps of (n, 3) odometry move."""
    return np.asarray((np.abs(between(odometry[:-1], odometry[1:])) > _STILL).any(axis=1))


def sudden_steps(odometry: Floats, config: SuddenStepConfig, stamps: Floats | None = None) -> Bools:
    """Which steps stand out: long, and much faster than nearly all others.

    Args:
        odometry: (n, 3) at each scan.
        config: how long, and how much faster.
        stamps: (n,) of the scans [s], which may stall and step back; left out, a pause explains nothing.

    Returns:
        (n - 1,) whether a step may be a jump of the odometry.
    """
    if stamps is None:
        return _beyond(odometry, config, np.ones(len(odometry) - 1))
    return _beyond(odometry, config, _perhaps_late(waits(stamps)))


def late_steps(odometry: Floats, config: SuddenStepConfig, stamps: Floats) -> Bools:
    """Which steps would be sudden, did the recorder not pause before the scan that they start from.

    They are what the robot did in the pause, if odometry comes a scan late: the scan before has shown it already.

    Args:
        odometry: (n, 3) at each scan.
        config: what is sudden.
        stamps: (n,) of the scans [s].

    Returns:
        (n - 1,).
    """
    periods = waits(stamps)
    return _beyond(odometry, config, periods) & ~_beyond(odometry, config, _perhaps_late(periods))


def usual_reach(odometry: Floats, share: float, stamps: Floats) -> Floats:
    """How far a robot gets from one scan to the next, in nearly all of the steps in which it moves.

    Args:
        odometry: (n, 3) at each scan.
        share: of the steps that are nearly all.
        stamps: (n,) of the scans [s].

    Returns:
        (2,) distance [m] and turn [rad] in a usual interval; zeros where it never moves.
    """
    moves = is_moving(odometry)
    if not moves.any():
        return np.zeros(2)
    steps = np.abs(between(odometry[:-1], odometry[1:])[moves])
    lengths = np.column_stack([np.hypot(steps[:, 0], steps[:, 1]), steps[:, 2]]) / waits(stamps)[moves, None]
    return np.quantile(lengths, share, axis=0)


def chained(start: Floats, steps: Floats) -> Floats:
    """Poses from increments.

    Args:
        start: (3,) the first pose.
        steps: (n - 1, 3) each pose in the frame of the one before.

    Returns:
        (n, 3).
    """
    poses = np.empty((len(steps) + 1, 3))
    poses[0] = start
    heading = start[2] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    c, s = cos_sin(heading[:-1])
    poses[1:, 0] = start[0] + np.cumsum(c * steps[:, 0] - s * steps[:, 1])
    poses[1:, 1] = start[1] + np.cumsum(s * steps[:, 0] + c * steps[:, 1])
    poses[:, 2] = wrap_angle(heading)
    return poses


def _perhaps_late(periods: Floats) -> Floats:
    """(n - 1,) waits, where odometry may come a scan late after a pause."""
    before: Floats = np.append(1.0, periods[:-1])
    return np.maximum(periods, before)


def _beyond(odometry: Floats, config: SuddenStepConfig, periods: Floats) -> Bools:
    """(n - 1,) whether the steps of (n, 3) odometry are too long for the (n - 1,) time that they took."""
    steps = between(odometry[:-1], odometry[1:])
    distance, turn = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    return _stand_out(distance, config.distance, periods, config) | _stand_out(turn, config.turn, periods, config)


def _stand_out(lengths: Floats, least: float, periods: Floats, config: SuddenStepConfig) -> Bools:
    usual = float(np.quantile(lengths / periods, config.nearly_all)) if len(lengths) else 0.0
    return lengths > np.maximum(least, config.factor * usual * periods)
