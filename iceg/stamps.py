"""Stamps that increase: public logs have stamps that jitter and step back, and many tools pair poses by sorted stamps.

File order is time order here, so the poses stay where they are and the stamps are repaired.
"""

import bisect

import numpy as np
from numpy.typing import NDArray

_PER_SECOND = 1_000_000
"""Files hold stamps to a microsecond; no two repaired stamps lie closer."""
_LATEST = 2.0**31
"""Up to here [s] float64 tells microseconds apart."""


def steps_back(stamps: NDArray[np.float64]) -> int:
    """How many of (n,) stamps [s] in file order are not later than the one before."""
    return int(np.count_nonzero(np.diff(stamps) <= 0))


def repaired_stamps(stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stamps that increase from each scan to the next.

    As many of the recorded stamps as can be are kept: the longest subsequence, in file order, that increases and leaves
    room for those between. The others are spread evenly between the kept ones around them, and continued by the median
    step before the first and behind the last. Stamps that increase already are kept as they are, to a microsecond.

    Args:
        stamps: (n,) in file order [s], finite.

    Returns:
        (n,) [s], each at least a microsecond after the one before; coarser where float64 does not tell those apart.
    """
    if len(stamps) == 0:
        return np.array(stamps, dtype=np.float64)
    latest = float(np.abs(stamps).max())
    if latest > _LATEST:
        return repaired_stamps(stamps * (_LATEST / latest)) * (latest / _LATEST)
    whole = np.floor(stamps)
    ticks = whole.astype(np.int64) * _PER_SECOND + np.round((stamps - whole) * _PER_SECOND).astype(np.int64)
    places = np.arange(len(ticks))
    kept = _longest_non_decreasing(ticks - places)
    step = max(1, int(np.median(np.diff(ticks[kept]) // np.diff(kept)))) if len(kept) > 1 else 1
    repaired = ticks[kept[0]] + step * (places - kept[0])
    for first, last in zip(kept[:-1].tolist(), kept[1:].tolist(), strict=True):
        rise, run = int(ticks[last] - ticks[first]), last - first
        repaired[first:last] = ticks[first] + rise * np.arange(run) // run
    repaired[kept[-1] :] = ticks[kept[-1]] + step * (places[kept[-1] :] - kept[-1])
    return np.where(repaired == ticks, stamps, repaired // _PER_SECOND + (repaired % _PER_SECOND) / _PER_SECOND)


def _longest_non_decreasing(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices of a longest non-decreasing subsequence of (n,) values, n ≥ 1 (patience sorting)."""
    ends: list[int] = []
    places: list[int] = []
    before = np.full(len(values), -1, dtype=np.int64)
    for place, value in enumerate(values.tolist()):
        length = bisect.bisect_right(ends, value)
        if length:
            before[place] = places[length - 1]
        ends[length : length + 1] = [value]
        places[length : length + 1] = [place]
    chain = [places[-1]]
    while (previous := int(before[chain[-1]])) >= 0:
        chain.append(previous)
    return np.array(chain[::-1], dtype=np.int64)
