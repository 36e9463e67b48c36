"""Readings of the odometry that are held: the same one again while the robot moves, until a leap makes up for it.

Wheels are read more seldom than the laser, or the recorder stalls for a second. Taken as read, the robot stands and
then leaps, which matches contradict. What speaks for it is that velocities change little from one scan to the next: the
leap spread over the scans since the reading before fits to the velocities around it, the leap itself does not.
"""

import math
from dataclasses import replace

import numpy as np

from frontends.scan import Log
from graph.arrays import Bools, Float32s, Floats, Ints
from graph.elementary import log
from graph.se2 import between, compose
from iceg.slam.recording.intervals import waits
from iceg.slam.recording.repeated_scans import is_repeated
from iceg.slam.recording.standstill import scans_change
from iceg.slam.recording.steps import is_moving
from iceg.slam.tracking_config import StandstillConfig

_ROUNDS = 20
"""The share of held readings and which of them are held follow each other; few rounds settle both."""
_ALL_BUT_FEW = 0.99
"""Of the steps of a log; no leap is made up of faster ones."""
_NEARLY_ALL, _NORMAL_QUANTILE = 0.9, 1.645
"""Nine of ten changes of a normal distribution are smaller than 1.645 standard deviations."""


def with_odometry_between_readings(log: Log, config: StandstillConfig) -> Log:
    """The same log; where its odometry holds a reading, with odometry at every scan, and a warning."""
    if not log.has_odometry:
        return log
    is_new = ~is_repeated(log.ranges)  # lines written twice hold the same scan with the same odometry
    odometry, periods = log.odometry[is_new], waits(log.stamps[is_new])
    moves, spread = held_readings(odometry, periods, config)
    spread = np.where(_are_confirmed(log.ranges[is_new], moves, spread, config), spread, 1)
    stamps = log.stamps[is_new]
    is_short = stamps[moves + 1] - stamps[moves + 1 - spread] <= config.held_longest
    is_arc = is_short | (spread <= config.held_scans)
    spread = np.where(is_arc, spread, 1)
    if not (spread > 1).any():
        return log
    filled = between_readings(odometry, periods, moves, spread)[np.cumsum(is_new) - 1]
    n_scans, at = int((spread - 1).sum()), int(np.argmax(spread > 1))
    first = int(np.flatnonzero(is_new)[moves[at] + 2 - spread[at]])
    warning = (
        f"the odometry repeats a reading in {n_scans} scan{'s' * (n_scans != 1)} while the robot moves, and makes up "
        f"for it at once, first at scan {first}: it is interpolated in between"
    )
    return replace(log, odometry=filled, warnings=(*log.warnings, warning))


def held_readings(odometry: Floats, periods: Floats, config: StandstillConfig) -> tuple[Ints, Ints]:
    """The steps of an odometry that move, and over how many scans each was made.

    A step that follows upon a standstill was made in one scan, or in the last h of those since the reading before. Each
    way takes a stop and a start, or goes on; these cost by how far speed and turn rate change on the whole, so that a
    start from rest costs what it leads to, and a leap twice what it exceeds that by. That a reading is held for h scans
    is the less probable the more they are, as 1/h, and no robot goes much faster than it does elsewhere. The likelihood
    ratio decides, and how often readings are held in this log.

    Args:
        odometry: (n, 3) at each scan.
        periods: (n - 1,) time from scan to scan, in usual ones: a pause of the recording explains a leap.
        config: how probable it is that a reading is held.

    Returns:
        (m,) index of the scan before each step; (m,) scans that it took, 1 as read.
    """
    moves = np.flatnonzero(is_moving(odometry))
    spread = np.ones(len(moves), dtype=np.int64)
    since = np.diff(moves, prepend=-1)
    after_standstill = np.flatnonzero(since[1:] > 1) + 1
    if not len(after_standstill):
        return moves, spread
    T_before_after = between(odometry[moves], odometry[moves + 1])
    steps = np.column_stack([np.hypot(T_before_after[:, 0], T_before_after[:, 1]), T_before_after[:, 2]])
    clock = np.concatenate([[0.0], np.cumsum(periods)])
    velocities = steps / np.diff(clock[moves + 1], prepend=0.0)[:, None]
    usual = np.quantile(np.abs(np.diff(velocities, axis=0)), _NEARLY_ALL, axis=0) / _NORMAL_QUANTILE
    scale = np.maximum(usual, config.least_change)
    steps, velocities = steps / scale, velocities / scale
    fastest = config.fastest * np.quantile(np.abs(velocities), _ALL_BUT_FEW, axis=0)
    gains, spans = np.zeros(len(after_standstill)), np.ones(len(after_standstill), dtype=np.int64)
    for row, k in enumerate(after_standstill.tolist()):
        before = velocities[max(k - 2, 0) : k].mean(axis=0)
        after = velocities[k + 1 : k + 3].mean(axis=0) if k + 1 < len(moves) else before
        since_each = clock[moves[k] + 1] - clock[moves[k] + 1 - since[k] : moves[k] + 1]
        during = steps[k] / since_each[::-1, None]
        gains[row], spans[row] = _likeliest_span(before, during, after, fastest, config.held_freedom)
    most = 1.0 - config.held_prior
    started = config.stops * len(moves) / len(after_standstill)
    share = least = min(max(1.0 - started, config.held_prior), most)
    for _ in range(_ROUNDS):
        is_held = gains > math.log((1.0 - share) / share)
        share = min(max(float(np.mean(is_held)), least), most)
    spread[after_standstill[is_held]] = spans[is_held]
    return moves, spread


def _likeliest_span(
    before: Floats, during: Floats, after: Floats, fastest: Floats, freedom: float
) -> tuple[float, int]:
    """By how much it is more probable that a step took several scans than one, and over how many that is so.

    Args:
        before: (2,) speed and turn rate before the standstill.
        during: (h, 2) those of the step if it took 1, 2, … scans, as many as there are since the reading before.
        after: (2,) those after it.
        fastest: (2,) that a robot may have.
        freedom: degrees of freedom of Student's t for changes of velocity.
    """
    costs = _cost(_length(before), freedom) + _cost(_length(during) + _length(after - during), freedom)
    costs[-1] = _cost(_length(during[-1] - before), freedom) + _cost(_length(after - during[-1]), freedom)
    several = costs[1:] + log(np.arange(2, len(costs) + 1))
    several[(np.abs(during[1:]) > fastest).any(axis=1)] = np.inf
    return costs[0] - several.min(), 2 + int(several.argmin())


def _are_confirmed(ranges: Float32s, moves: Ints, spread: Ints, config: StandstillConfig) -> Bools:
    """(m,) which held readings are so short, or so usual, or show scans that change: odometry is set anew at rest, too.

    Args:
        ranges: (n, n_beams) [m], NaN where nothing came back.
        moves: (m,) see `held_readings` …
        spread: (m,) ….
        config: what changes.
    """
    few = max(config.unjudged, 2 * int(np.median(np.diff(moves, prepend=-1)))) if len(moves) else 0
    confirmed = np.ones(len(moves), dtype=np.bool_)
    for k in np.flatnonzero(spread > few).tolist():
        confirmed[k] = scans_change(ranges[moves[k] + 2 - spread[k] : moves[k] + 1], config)
    return confirmed


def between_readings(odometry: Floats, periods: Floats, moves: Ints, spread: Ints) -> Floats:
    """Odometry at the scans between two readings: each step spread over the scans that it took, by their time.

    Args:
        odometry: (n, 3) at each scan.
        periods: (n - 1,) see `held_readings` …
        moves: (m,) …
        spread: (m,) ….

    Returns:
        (n, 3) the same at every reading.
    """
    filled = odometry.copy()
    for move, n in zip(moves.tolist(), spread.tolist(), strict=True):
        step, times = between(odometry[move], odometry[move + 1]), np.cumsum(periods[move + 1 - n : move + 1])
        filled[move + 2 - n : move + 1] = compose(odometry[move], times[:-1, None] / times[-1] * step)
    return filled


def _length(vectors: Floats) -> Floats:
    """(...) of (..., 2)."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)), dtype=np.float64)


def _cost(changes: Floats, freedom: float) -> Floats:
    """Negative log-likelihood of changes of velocity, by Student's t."""
    return np.asarray(0.5 * (freedom + 2.0) * log(1.0 + changes * changes / freedom), dtype=np.float64)
