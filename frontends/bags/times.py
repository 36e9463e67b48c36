"""Which of a message's two times counts: its own stamp, and where that means nothing the time of recording."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.pose_samples import is_gap

_ANOTHER_CLOCK = 3600.0
"""Stamps whose distance from the recording differs by more than this [s] from the rest's are of another clock."""
_CLOSE, _MOSTLY = 0.5, 0.2
"""Stamps run through the same time again where, in their order, more than this share of the scans follow each other
within half of the usual period."""
_REACH = 0.5
"""A source of poses tells of times that lie up to this [s] outside its own."""
_CLOCKS_APART, _STEADY = 2.0, 0.25
"""Two sources that are recorded so much [s] later after their stamps, the one than the other, have two clocks, if the
difference varies by no more than this share of it."""
_ENOUGH = 0.5
"""Share of the scans that the stamps of a source must cover to be of the same clock."""


@dataclass(frozen=True, kw_only=True)
class ScanTimes:
    """When the scans were taken.

    Attributes:
        order: (n,) the messages in the order of time.
        stamps: (n,) in that order [s].
        behind: by how much the recording lags behind the stamps, in the middle [s]; 0 where the stamps are those of
            the recording.
        are_recorded: whether the stamps are those of the recording.
        warnings: what a person should know.
    """

    order: NDArray[np.int64]
    stamps: NDArray[np.float64]
    behind: float
    are_recorded: bool
    warnings: tuple[str, ...]


def scan_times(stamps: NDArray[np.float64], recorded: NDArray[np.float64]) -> ScanTimes:
    """Put scans in the order of time.

    Args:
        stamps: (n,) of the messages themselves [s].
        recorded: (n,) when they were recorded [s].
    """
    if len(stamps) > 1 and float(np.ptp(stamps)) == 0.0:
        return _as_recorded(recorded, f"all stamps are {stamps[0]:g} s: the times of recording are taken")
    lag = recorded - stamps
    behind = float(np.median(lag))
    elsewhere = np.abs(lag - behind) > _ANOTHER_CLOCK
    times = np.where(elsewhere, recorded - behind, stamps)
    warnings = []
    if elsewhere.any():
        warnings.append(
            f"{int(elsewhere.sum())} scans bear stamps of another clock: they are placed by the times of recording"
        )
    order = np.argsort(times, kind="stable")
    if _runs_again(times, order, recorded):
        again = "the stamps run through the same time more than once: the times of recording are taken"
        return _as_recorded(recorded, again)
    late = int(np.count_nonzero(times < np.maximum.accumulate(times)))
    if late:
        warnings.append(f"{late} scans arrived behind later ones: they are put in the order of their stamps")
    return ScanTimes(order=order, stamps=times[order], behind=behind, are_recorded=False, warnings=tuple(warnings))


def pose_times(
    stamps: NDArray[np.float64], recorded: NDArray[np.float64], scans: ScanTimes
) -> tuple[NDArray[np.float64], list[str]]:
    """The times of a source of poses on the clock of the scans.

    Args:
        stamps: (n,) of the messages themselves [s].
        recorded: (n,) when they were recorded [s].
        scans: the times of the scans.

    Returns:
        (n,) [s], and what a person should know.
    """
    if scans.are_recorded:
        return recorded, []
    lag = recorded - stamps
    apart = float(np.median(lag)) - scans.behind
    is_steady = float(np.ptp(np.percentile(lag, (10.0, 90.0)))) < _STEADY * abs(apart)
    is_apart = abs(apart) > _CLOCKS_APART and is_steady
    if not is_apart and covered(stamps, scans.stamps).mean() >= _ENOUGH:
        return stamps, []
    # Another clock runs evenly, unless it stands still: only the distance is wrong.
    aligned = stamps + apart if float(np.ptp(stamps)) > 0.0 else recorded - scans.behind
    if covered(aligned, scans.stamps).mean() < _ENOUGH:
        return stamps, []
    return aligned, [
        f"the stamps are of another clock than the scans', {abs(apart):.1f} s off: the times of recording align them"
    ]


def covered(times: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the times `at` lie within those of a source, or hardly outside, and in no gap of it."""
    if not len(times):
        return np.zeros(len(at), dtype=np.bool_)
    times = np.unique(times)
    within: NDArray[np.bool_] = (at >= times[0] - _REACH) & (at <= times[-1] + _REACH)
    if len(times) > 1:
        within &= ~is_gap(times)[np.clip(np.searchsorted(times, at), 1, len(times) - 1) - 1]
    return within


def _as_recorded(recorded: NDArray[np.float64], why: str) -> ScanTimes:
    order = np.argsort(recorded, kind="stable")
    return ScanTimes(order=order, stamps=recorded[order], behind=0.0, are_recorded=True, warnings=(why,))


def _runs_again(times: NDArray[np.float64], order: NDArray[np.int64], recorded: NDArray[np.float64]) -> bool:
    steps = np.diff(times)
    forward = steps[steps > 0.0]
    if not len(forward) or len(forward) == len(steps):
        return False
    sorted_steps = np.diff(times[order])
    period = min(float(np.median(forward)), float(np.median(np.diff(np.sort(recorded)))))
    return bool(np.mean(sorted_steps < _CLOSE * period) > _MOSTLY)
