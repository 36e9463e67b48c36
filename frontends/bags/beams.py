"""The bearings that LaserScan messages state, as those of one laser: from right to left, each direction once."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.bags.records import ScanRecords
from frontends.logs.beams import place_on_bearings

_WHOLE_TURN = 2.0 * math.pi
_MOST_BEAMS = 1_000_000
_MOST_FIRST = 2.0 * _WHOLE_TURN
"""A first beam farther round [rad] is stated in another unit, and where it points is unknown."""


class Spread(NamedTuple):
    """How the beams of a message are spread.

    Attributes:
        n_beams: number of readings.
        first: bearing of the first [rad].
        step: from each to the next, negative from left to right [rad].
    """

    n_beams: int
    first: float
    step: float


class StackedSweeps(NamedTuple):
    """The sweeps of one laser on common bearings.

    Attributes:
        sweeps: (k,) which of the messages they are: those that make a scan.
        ranges: (k, n_beams) readings [m], as recorded.
        bearings: (n_beams,) increasing [rad].
        is_clockwise: whether the messages list the beams from left to right.
        warnings: what a person should know.
    """

    sweeps: NDArray[np.int64]
    ranges: NDArray[np.float32]
    bearings: NDArray[np.float64]
    is_clockwise: bool
    warnings: list[str]


def stack(scans: ScanRecords) -> StackedSweeps | None:
    """Bring the sweeps of a laser together; None where no message makes a scan."""
    found = {key: _spread(*key) for key in dict.fromkeys(_keys(scans))}
    spreads = [found[key] for key in _keys(scans)]
    counted = Counter(spread for spread in spreads if spread is not None)
    if not counted:
        return None
    usual = counted.most_common(1)[0][0]
    kept = np.array([k for k, spread in enumerate(spreads) if spread is not None], dtype=np.int64)
    in_order = {spread: _in_order(spread) for spread in counted}
    bearings, usual_beams = in_order[usual]
    ranges = np.empty((len(kept), len(bearings)), dtype=np.float32)
    for row, k in enumerate(kept.tolist()):
        spread = spreads[k]
        assert spread is not None
        is_usual = spread is usual or spread == usual
        ranges[row] = (
            scans.ranges[k][usual_beams] if is_usual else _placed(scans.ranges[k], *in_order[spread], bearings)
        )
    return StackedSweeps(kept, ranges, bearings, usual.step < 0.0, _warnings(spreads, counted, usual))


def why_no_scan(scans: ScanRecords) -> str:
    """What to say of a laser none of whose messages makes a scan, by the most frequent of its settings."""
    n_beams, first, last, step = Counter(_keys(scans)).most_common(1)[0][0]
    if n_beams < 2:
        return f"found {n_beams} readings, expected 2 or more"
    found = f"found {n_beams} beams from {first:g} to {last:g} rad, {step:g} rad apart"
    in_degrees = _spread(n_beams, math.radians(first), math.radians(last), math.radians(step)) is not None
    expected = "radians: these look like degrees" if in_degrees else "more than 0 and at most 2π rad"
    return f"{found}, expected {expected}"


def _keys(scans: ScanRecords) -> list[tuple[int, float, float, float]]:
    return [
        (len(ranges), setting[0], setting[1], setting[2])
        for ranges, setting in zip(scans.ranges, scans.settings, strict=True)
    ]  # angle_min, angle_max, angle_increment


def _spread(n_beams: int, first: float, last: float, step: float) -> Spread | None:
    """The spread that a message states: first bearing and step, else first and last bearing; None for nonsense."""
    if not 2 <= n_beams <= _MOST_BEAMS or not abs(first) <= _MOST_FIRST:  # neither is NaN
        return None
    if not _fits(step, n_beams):
        step = (last - first) / (n_beams - 1)
    if not _fits(step, n_beams):
        return None
    centre = first + 0.5 * step * (n_beams - 1)
    return Spread(n_beams, first - _WHOLE_TURN * round(centre / _WHOLE_TURN - 1e-9), step)


def _fits(step: float, n_beams: int) -> bool:
    """Whether so many steps make no more than a turn, give or take a beam and a half."""
    return math.isfinite(step) and step != 0.0 and abs(step) * (n_beams - 2.5) <= _WHOLE_TURN


def _in_order(spread: Spread) -> tuple[NDArray[np.float64], slice]:
    """Increasing bearings [rad] without those that come again after a turn, and the readings that they belong to."""
    n_beams, first, step = spread
    once = min(n_beams, math.ceil(_WHOLE_TURN / abs(step) - 0.5))
    bearings = np.asarray(first + step * np.arange(once), dtype=np.float64)
    return (bearings, slice(0, once)) if step > 0 else (bearings[::-1].copy(), slice(once - 1, None, -1))


def _placed(
    readings: NDArray[np.float32], own: NDArray[np.float64], beams: slice, bearings: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Readings of other bearings on the usual ones."""
    turns = round(float(bearings[0] + bearings[-1] - own[0] - own[-1]) / (2.0 * _WHOLE_TURN))
    return place_on_bearings(readings[beams], own + _WHOLE_TURN * turns, bearings)


def _warnings(spreads: Sequence[Spread | None], counted: Counter[Spread], usual: Spread) -> list[str]:
    warnings = []
    nonsense = sum(spread is None for spread in spreads)
    if nonsense:
        warnings.append(f"{nonsense} scans are left out: their angles and number of beams make no scan")
    others = sum(counted.values()) - counted[usual]
    if others:
        warnings.append(
            f"the beams change: {others} scans of {len(counted) - 1} other settings are placed on the usual"
            f" {usual.n_beams} bearings"
        )
    return warnings
