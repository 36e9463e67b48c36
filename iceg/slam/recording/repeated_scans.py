"""Scans that come again to the last bit: a laser that froze, or a recorder that writes lines twice."""

from dataclasses import replace

import numpy as np

from frontends.scan import Log
from graph.arrays import Bools, Float32s
from iceg.slam.recording.steps import is_moving


def is_repeated(ranges: Float32s) -> Bools:
    """(n,) which of (n, n_beams) scans are the same as the one before; noise alone makes any two differ."""
    bits = np.ascontiguousarray(ranges, dtype=np.float32).view(np.int32)
    return np.concatenate([np.zeros(min(len(bits), 1), dtype=np.bool_), (bits[1:] == bits[:-1]).all(axis=1)])


def frozen_intervals(log: Log) -> list[tuple[int, int]]:
    """First and last scan of each interval over which the laser repeats itself, but the odometry moves.

    A scan without any return says nothing anyway.
    """
    repeated = is_repeated(log.ranges) & np.isfinite(log.ranges).any(axis=1)
    if not (log.has_odometry and repeated.any()):
        return []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], repeated.astype(np.int8), [0]])))
    moves = is_moving(log.odometry)
    return [(first, end - 1) for first, end in edges.reshape(-1, 2).tolist() if moves[first - 1 : end - 1].any()]


def without_frozen_scans(log: Log) -> Log:
    """The same log; where its laser is frozen while the odometry moves, with nothing seen and a warning."""
    intervals = frozen_intervals(log)
    if not intervals:
        return log
    ranges = log.ranges.copy()
    for first, last in intervals:
        ranges[first : last + 1] = np.nan
    n_scans = sum(last + 1 - first for first, last in intervals)
    warning = (
        f"the laser repeats itself in {n_scans} scans while the odometry moves, first from scan {intervals[0][0]} to "
        f"scan {intervals[0][1]}: they are not believed"
    )
    return replace(log, ranges=ranges, warnings=(*log.warnings, warning))
