"""Which readings of a laser are returns: no-return marks and the usable range, found in the readings themselves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

DEFAULT_RANGE_MIN = 0.02
DEFAULT_RANGE_CAP = 40.0

_MARK_WIDTH = 0.002  # relative: SICK's error codes 81.83 to 81.91 lie this close together
_MARK_VALUES = 9  # and are nine
_MARK_REPEATS = 5
_SICK_CODES = (81.825, 81.915)


@dataclass(frozen=True, slots=True, kw_only=True)
class UsableRange:
    """The readings that are returns: `range_min` ≤ r ≤ `range_max` [m].

    Attributes:
        range_min: [m].
        range_max: [m].
        readings: the shortest and the longest above zero [m]; None where there are none, or nobody looked.
    """

    range_min: float
    range_max: float
    readings: tuple[float, float] | None = None


def usable_range(
    readings: NDArray[np.float32],
    *,
    range_min: float | None = None,
    range_max: float | None = None,
    stated_max: float = np.inf,
) -> UsableRange:
    """Derive the usable range from all readings of a log.

    Zero, negative, NaN and infinite readings are never returns. Beyond that:

    - *The far constant.* Lasers write a constant where nothing came back (81.83 and 81.91 m, 50 m, the simulator's
      limit). It shows as a pile-up at the greatest reading: of the readings within 0.2 % below it there are at most
      nine different values (the number of SICK's error codes), each repeated five times or more on average, and at
      least five times as many as in the equally wide interval just below. A greatest reading among SICK's error codes
      is one whatever its count. A log whose readings are all the same proves nothing, they stay.
    - *A stated limit.* Readings at or beyond the maximum range that the messages state are no returns.
    - *The longest.* `range_max` is the longest reading left up to 40 m: beyond, SICK's readings hit nothing that later
      scans find again. An explicit `range_max` replaces this rule, not the two above.
    - *The shortest.* `range_min` is 2 cm: Hokuyo scanners write their error codes 0 to 19 in millimetres.

    Args:
        readings: (n_scans, n_beams) as recorded [m].
        range_min: shortest return [m]; None for the default.
        range_max: longest return [m]; None to derive it.
        stated_max: the limit that the log's own messages state [m].
    """
    shortest = DEFAULT_RANGE_MIN if range_min is None else range_min
    positive = readings[np.isfinite(readings) & (readings > 0)]
    no_return = _far_constant(positive)
    ceiling = min(stated_max, no_return * (1.0 - _MARK_WIDTH) if np.isfinite(no_return) else np.inf)
    if range_max is None or range_max >= ceiling:
        longest = _longest(positive, below=ceiling, cap=DEFAULT_RANGE_CAP if range_max is None else np.inf)
    else:
        longest = range_max
    found = (float(positive.min()), float(positive.max())) if len(positive) else None
    return UsableRange(range_min=shortest, range_max=max(longest, shortest), readings=found)


def mask_no_returns(readings: NDArray[np.float32], usable: UsableRange) -> None:
    """Write NaN over every one of the (n_scans, n_beams) readings [m] that is no return, in place."""
    with np.errstate(invalid="ignore"):
        returns = (readings >= np.float32(usable.range_min)) & (readings <= np.float32(usable.range_max))
    readings[~returns] = np.nan


def warn_of_no_returns(ranges: NDArray[np.float32], usable: UsableRange) -> list[str]:
    """What to say where none of the (n_scans, n_beams) ranges is a usable return.

    Args:
        ranges: as `mask_no_returns` leaves them [m].
        usable: what it masked them by.
    """
    if np.isfinite(ranges).any():
        return []
    said = "no beam of any scan has a usable return"
    if usable.readings is None:
        return [said]
    shortest, longest = usable.readings
    asked = ": are they in millimetres?" if shortest > usable.range_max else ""
    said += f": readings run from {shortest:.6g} to {longest:.6g}"
    return [f"{said}, and only those from {usable.range_min:g} m to {usable.range_max:g} m count{asked}"]


def _longest(positive: NDArray[np.float32], *, below: float, cap: float) -> float:
    longest = float(np.max(positive, initial=0.0, where=(positive < below) & (positive <= np.float32(cap))))
    return longest if longest > 0.0 else min(DEFAULT_RANGE_CAP, below)


def _far_constant(positive: NDArray[np.float32]) -> float:
    """The constant that stands for 'no return' [m], NaN when the greatest reading is a reading like others."""
    if len(positive) == 0:
        return np.nan
    greatest = float(positive.max())
    if _SICK_CODES[0] <= greatest <= _SICK_CODES[1]:
        return greatest
    top = positive[positive >= np.float32(greatest * (1.0 - _MARK_WIDTH))]
    below = int(np.count_nonzero(positive >= np.float32(greatest * (1.0 - 2.0 * _MARK_WIDTH)))) - len(top)
    distinct = len(np.unique(top))
    piled_up = distinct <= _MARK_VALUES and len(top) >= _MARK_REPEATS * max(distinct, below)
    return greatest if piled_up and len(top) < len(positive) else np.nan
