"""Readings of the odometry that are held: the same one again while the robot moves, until a leap makes up for it.

Wheels are read more seldom than the laser, or the recorder stalls for a second. Taken as read, the robot stands and
then leaps, which matches contradict. What speaks for it is that velocities change little from one scan to the next: the
leap spread over the scans since the reading before fits to the velocities around it, the leap itself does not.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.se2 import between, compose
from iceg.slam.recording.repeated_scans import is_repeated
from iceg.slam.recording.steps import is_moving, waits
from iceg.slam.tracking_config import StandstillConfig


def with_odometry_between_readings(log: Log, config: StandstillConfig) -> Log:
    """The same log; where its odometry holds a reading, with odometry at every scan, and a warning."""
    if not log.has_odometry:
        return log
    is_new = ~is_repeated(log.ranges)  # lines written twice hold the same scan with the same odometry
    odometry = log.odometry[is_new]
    moves, spread = held_readings(odometry, log.stamps[is_new], config)
    if not (spread > 1).any():
        return log
    filled = between_readings(odometry, moves, spread)[np.cumsum(is_new) - 1]
    n_scans, at = int((spread - 1).sum()), int(np.argmax(spread > 1))
    first = int(np.flatnonzero(is_new)[moves[at] + 2 - spread[at]])
    warning = (
        f"the odometry repeats a reading in {n_scans} scans while the robot moves, and makes up for it at once, first "
        f"at scan {first}: it is interpolated in between"
    )
    return replace(log, odometry=filled, warnings=(*log.warnings, warning))


def held_readings(
    odometry: NDArray[np.float64], stamps: NDArray[np.float64], config: StandstillConfig
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The steps of an odometry that move, and over how many scans each was made.

    A step that follows upon a standstill was made in one scan, or in the last h of those since the reading before. Each
    costs the squared changes of speed and turn rate that it takes, in the variance of those of the whole log; that the
    robot stands costs nothing where the step is taken as read. The likelihood ratio decides, and how often readings
    are held in this log.

    Args:
        odometry: (n, 3) at each scan.
        stamps: (n,) of the scans [s]: a pause of the recording explains a leap.
        config: how probable it is that a reading is held.

    Returns:
        (m,) index of the scan before each step; (m,) scans that it took, 1 as read.
    """
    moves = np.flatnonzero(is_moving(odometry))
    spread = np.ones(len(moves), dtype=np.int64)
    if len(moves) < 2:
        return moves, spread
    T_before_after = between(odometry[moves], odometry[moves + 1])
    steps = np.column_stack([np.hypot(T_before_after[:, 0], T_before_after[:, 1]), T_before_after[:, 2]])
    since = np.diff(moves, prepend=-1)
    velocities = steps / since[:, None]
    usual = np.quantile(np.abs(np.diff(velocities, axis=0)), _NEARLY_ALL, axis=0) / _NORMAL_QUANTILE
    scale = np.maximum(usual, config.least_change)
    steps, velocities = steps / scale, velocities / scale
    as_read = steps / waits(stamps)[moves, None]
    after_standstill = np.flatnonzero(since[1:] > 1) + 1
    gains, spans = np.zeros(len(after_standstill)), np.ones(len(after_standstill), dtype=np.int64)
    for row, k in enumerate(after_standstill.tolist()):
        before = velocities[max(k - 2, 0) : k].mean(axis=0)
        after = velocities[k + 1 : k + 3].mean(axis=0) if k + 1 < len(moves) else before
        h = np.arange(2, since[k] + 1)
        during = steps[k] / h[:, None]
        stood = np.append(_squared(during[:-1]) + _squared(before), _squared(during[-1] - before))
        costs = stood + _squared(after - during)
        gains[row], spans[row] = 0.5 * (_squared(after - as_read[k]) - costs.min()), h[costs.argmin()]
    share = config.held_prior
    for _ in range(2):  # the second time with the share that the first has found
        is_held = gains > math.log((1.0 - share) / share)
        share = float(np.clip(np.mean(is_held) if len(is_held) else 0.0, config.held_prior, 1.0 - config.held_prior))
    spread[after_standstill[is_held]] = spans[is_held]
    return moves, spread


def between_readings(
    odometry: NDArray[np.float64], moves: NDArray[np.int64], spread: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Odometry at the scans between two readings: each step spread evenly over the scans that it took.

    Args:
        odometry: (n, 3) at each scan.
        moves: (m,) see `held_readings` …
        spread: (m,) ….

    Returns:
        (n, 3) the same at every reading.
    """
    filled = odometry.copy()
    for move, n in zip(moves.tolist(), spread.tolist(), strict=True):
        step = between(odometry[move], odometry[move + 1])
        shares = np.arange(1, n)[:, None] / n
        filled[move + 2 - n : move + 1] = compose(odometry[move], shares * step)
    return filled


_NEARLY_ALL, _NORMAL_QUANTILE = 0.9, 1.645
"""Nine of ten changes of a normal distribution are smaller than 1.645 standard deviations."""


def _squared(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...) squared length of (..., 2)."""
    return np.asarray((vectors * vectors).sum(axis=-1))
