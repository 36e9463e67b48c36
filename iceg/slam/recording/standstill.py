"""Odometry that stands still although the robot moves: read anew more seldom than the laser, or no longer at all."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.se2 import between, compose
from iceg.slam.recording.repeated_scans import is_repeated
from iceg.slam.recording.steps import is_moving
from iceg.slam.run_warning import RunWarning

_SELDOM = 0.5
"""Where more of the moves than this follow upon a standstill, odometry is read more seldom than the laser."""
_FEWEST_MOVES = 20
"""Fewest moves that tell how often the odometry is read."""
_ENDS = 3
"""Scans at either end of a standstill that may show the robot's move already, or still: two clocks."""
_SAMPLES = 64
"""Scans of a standstill that are compared with its beginning."""
_CHANGED, _CHANGED_FACTOR = 0.1, 3.0
"""Change of the readings [m], and how many times that from one scan to the next, that only a move explains …"""
_UNCHANGED = 0.25
"""… if no more than this share of the beams is changed less, for people hide what is behind them …"""
_CHANGED_SAMPLES = 3
"""… and scans that must show it."""
_RETURNS = 0.2
"""Share of the beams that two scans need in common."""


def with_odometry_between_readings(log: Log) -> Log:
    """The same log; where its odometry is read more seldom than its laser, with odometry at every scan."""
    if not log.has_odometry:
        return log
    is_new = ~is_repeated(log.ranges)  # lines written twice hold the same scan with the same odometry
    odometry = log.odometry[is_new]
    period = reading_period(odometry)
    if period == 1:
        return log
    spread = between_readings(odometry, period)[np.cumsum(is_new) - 1]
    warning = f"the odometry is read anew only once in {period} scans: it is interpolated in between"
    return replace(log, odometry=spread, warnings=(*log.warnings, warning))


def reading_period(odometry: NDArray[np.float64]) -> int:
    """How many scans lie from one reading of the odometry to the next, while the robot moves.

    Args:
        odometry: (n, 3) at each scan.

    Returns:
        1 where there is one for each scan, as there should be.
    """
    waits = np.diff(_moves(odometry))
    if len(waits) < _FEWEST_MOVES or float(np.mean(waits > 1)) <= _SELDOM:
        return 1
    return int(np.median(waits))


def between_readings(odometry: NDArray[np.float64], period: int) -> NDArray[np.float64]:
    """Odometry at the scans between two readings: each move spread evenly over the scans since the last reading.

    Args:
        odometry: (n, 3) at each scan.
        period: how many scans lie between two readings; a longer standstill was one, but for its end.

    Returns:
        (n, 3) the same at every reading.
    """
    moves = _moves(odometry)
    spread = odometry.copy()
    for move, wait in zip(moves.tolist(), np.diff(moves, prepend=-1).tolist(), strict=True):
        n = min(wait, period)
        step = between(odometry[move], odometry[move + 1])
        shares = np.arange(1, n)[:, None] / n
        spread[move + 2 - n : move + 1] = compose(odometry[move], shares * step)
    return spread


def dead_intervals(odometry: NDArray[np.float64], ranges: NDArray[np.float32]) -> list[tuple[int, int]]:
    """Intervals of a log over which the odometry stands still while the scans say that the robot moves.

    Args:
        odometry: (n, 3) at each scan.
        ranges: (n, n_beams) [m], NaN where nothing came back.

    Returns:
        First and last scan of each; between them, odometry says nothing.
    """
    return [(first, last) for first, last in _standstills(odometry) if _scans_change(ranges[first : last + 1])]


def describe_dead(first: int, last: int) -> RunWarning:
    """An interval without odometry in a sentence for a person."""
    sentence = (
        f"the odometry stands still from scan {first} to scan {last} while the scans change: it is not believed there"
    )
    return RunWarning(kind="odometry stands still", sentence=sentence, scan=first)


def _standstills(odometry: NDArray[np.float64]) -> Iterator[tuple[int, int]]:
    """First and last scan of each run of equal readings that is long enough to be judged."""
    moves = _moves(odometry).tolist()
    for first, last in zip([0, *(move + 1 for move in moves)], [*moves, len(odometry) - 1], strict=True):
        if last - first > 2 * _ENDS + _CHANGED_SAMPLES:
            yield first, last


def _scans_change(ranges: NDArray[np.float32]) -> bool:
    """Whether several scans differ from one at the beginning by more than noise and passers-by explain."""
    samples = np.unique(np.linspace(_ENDS + 1, len(ranges) - 1 - _ENDS, _SAMPLES).astype(int))
    changes = _changes(ranges[_ENDS], ranges[samples])
    if np.count_nonzero(changes > _CHANGED) < _CHANGED_SAMPLES:
        return False
    noise = np.median(_changes(ranges[samples - 1], ranges[samples]))
    return int(np.sum(changes > max(_CHANGED, _CHANGED_FACTOR * noise))) >= _CHANGED_SAMPLES


def _changes(before: NDArray[np.float32], after: NDArray[np.float32]) -> NDArray[np.float64]:
    """Change of the beams that scans have in common, the least but for a few; 0 if these are few.

    Args:
        before: (n_beams,) or (n, n_beams) [m].
        after: (n, n_beams) [m].

    Returns:
        (n,) [m].
    """
    differences = np.abs(after - before)
    differences[~np.isfinite(differences)] = np.inf
    differences.sort(axis=1)
    common = np.count_nonzero(differences < np.inf, axis=1)
    changes, rows = np.zeros(len(differences)), np.flatnonzero(common > _RETURNS * differences.shape[1])
    at = _UNCHANGED * (common[rows] - 1)
    below = at.astype(np.int64)
    least, next_least = differences[rows, below], differences[rows, np.minimum(below + 1, common[rows] - 1)]
    changes[rows] = least + (at - below) * (next_least - least)
    return changes


def _moves(odometry: NDArray[np.float64]) -> NDArray[np.int64]:
    """(m,) the steps that move."""
    return np.flatnonzero(is_moving(odometry))
