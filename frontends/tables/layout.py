"""The layout that all tables of scans share: one row a scan, and what holds for all of them.

Columns: `stamp_s`; `odom_x_m`, `odom_y_m`, `odom_theta_rad`; `truth_x_m`, `truth_y_m`, `truth_theta_rad`; `gyro_x`,
`gyro_y`, `gyro_z`, turn rates integrated up to each scan, in any unit; `range_0` to `range_N` [m], of which only the
ranges must be there. What holds for all scans: `bearings_rad`, or `first_bearing_rad` and `bearing_step_rad`, or
`field_of_view_rad`; `range_min_m`, `range_max_m`; `laser_x_m`, `laser_y_m`, `laser_theta_rad`; `sweep_s`; of which only
the beams' directions must be there.
"""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs.errors import LogError
from frontends.scan import Log, ScanError

STAMP = "stamp_s"
ODOMETRY = ("odom_x_m", "odom_y_m", "odom_theta_rad")
TRUTH = ("truth_x_m", "truth_y_m", "truth_theta_rad")
GYRO = ("gyro_x", "gyro_y", "gyro_z")
FINITE = frozenset({STAMP, *ODOMETRY, *TRUTH, *GYRO})
"""Columns of which each row must hold a finite number."""
RANGE = "range_"
_BEARINGS, _FIRST, _STEP, _VIEW = "bearings_rad", "first_bearing_rad", "bearing_step_rad", "field_of_view_rad"
_LIMITS = ("range_min_m", "range_max_m")
_MOUNT = ("laser_x_m", "laser_y_m", "laser_theta_rad")
_SWEEP = "sweep_s"
SETTINGS = (_BEARINGS, _FIRST, _STEP, _VIEW, *_LIMITS, *_MOUNT, _SWEEP)
"""What holds for all scans."""
_DIGITS = re.compile(r"\d+")
_COLUMNS = (STAMP, *ODOMETRY, *TRUTH, *GYRO, *SETTINGS, f"{RANGE}0")
"""What a misspelt column may be meant as; the beam's number makes it no other."""


@dataclass(frozen=True, kw_only=True)
class ScanTable:
    """A table of scans.

    Attributes:
        settings: what holds for all scans, by its name; a list of numbers each.
        columns: (n,) of each column but the ranges, by its name.
        ranges: (n, n_beams) [m]; NaN without return.
    """

    settings: Mapping[str, Sequence[float]]
    columns: Mapping[str, NDArray[np.float64]]
    ranges: NDArray[np.float32]


_MOST_DIGITS = 9
"""Of the number of a beam."""
_LIKE = 0.75
"""How like a known name one must be to be meant by it (`difflib`: 1 for the same): `laser_x` and `timestamps` are."""
_MOST_SHOWN, _MOST_NAMES = 40, 8
"""Letters of a name, and names, that a message shows."""


def is_known(column: str) -> bool:
    """Whether a column is part of the layout."""
    return column in _COLUMNS or is_range(column)


def is_range(column: str) -> bool:
    """Whether a column holds the readings of one beam."""
    number = column.removeprefix(RANGE)
    is_number = number.isascii() and number.isdecimal() and len(number) <= _MOST_DIGITS
    return column.startswith(RANGE) and is_number and number == str(int(number))


def may_be_table(columns: Iterable[str]) -> bool:
    """Whether columns are those of a table of scans: a stamp or a range is among them, perhaps misspelt."""
    needed = (STAMP, f"{RANGE}0")
    return any(name in needed or meant(name, needed) for name in {_DIGITS.sub("0", name) for name in columns})


def meant(name: str, known: Iterable[str]) -> str | None:
    """The known name that somebody meant who wrote another one; None where none is like it, or it is known."""
    names = list(known)
    return None if name in names else next(iter(get_close_matches(name, names, n=1, cutoff=_LIKE)), None)


def left_out(names: Iterable[str], known: Collection[str], kind: str, expected: str) -> list[str]:
    """What to say of names that are no part of a layout: what they hold is not read.

    Args:
        names: those that are none of it.
        known: its own.
        kind: what bears names, "arrays" or "columns".
        expected: what a person should know of its own names.

    Raises:
        ScanError: one seems to be misspelt.
    """
    unknown = list(names)
    first_of_kind: dict[str, str] = {}
    for name in unknown:
        first_of_kind.setdefault(_DIGITS.sub("0", name), name)
    for numbered, name in first_of_kind.items():
        like = meant(numbered, known)
        if like:
            raise ScanError(f"found the {kind.removesuffix('s')} {name[:_MOST_SHOWN]!r}, did you mean '{like}'?")
    shown = ", ".join(repr(name[:_MOST_SHOWN]) for name in unknown[:_MOST_NAMES])
    more = f" and {len(unknown) - _MOST_NAMES} more" if len(unknown) > _MOST_NAMES else ""
    return [f"found the {kind} {shown}{more}, expected {expected}: left out"] if unknown else []


def unknown_columns(columns: Iterable[str]) -> list[str]:
    """What to say of columns that are no part of the layout.

    Raises:
        ScanError: one seems to be misspelt.
    """
    unknown = (name for name in columns if not is_known(name))
    return left_out(unknown, _COLUMNS, "columns", f"{STAMP}, odom_…, truth_…, gyro_… and {RANGE}…")


def range_columns(path: Path, columns: Sequence[str]) -> list[str]:
    """The columns of the beams in the order of their numbers.

    Raises:
        LogError: there are none, or one is missing.
    """
    numbers = sorted(int(column.removeprefix(RANGE)) for column in columns if is_range(column))
    if numbers != list(range(len(numbers))) or len(numbers) < 2:
        found = f"{len(numbers)} columns from {RANGE}{numbers[0]} to {RANGE}{numbers[-1]}" if numbers else "none"
        raise LogError(f"{path}: found {found}, expected the columns {RANGE}0, {RANGE}1 … of the beams' readings")
    return [f"{RANGE}{number}" for number in numbers]


def log_of(path: Path, table: ScanTable, range_min: float | None, range_max: float | None) -> Log:
    """The log that a table holds.

    Args:
        path: where it was read from.
        table: its content.
        range_min: shortest return [m]; None for what the table states.
        range_max: longest return [m]; None for what the table states.

    Raises:
        LogError: the numbers make no log.
    """
    from frontends.arrays import log_from_arrays  # which judges odometry as the readers of logs do, this one among them

    settings = {name: list(values) for name, values in table.settings.items()}
    for name in SETTINGS:
        if name not in settings and len(table.columns.get(name, ())):
            settings[name] = [float(table.columns[name][0])]
    try:
        shortest, longest = (_number(settings, name) for name in _LIMITS)
        return log_from_arrays(
            table.ranges,
            bearings=_bearings(settings, table.ranges.shape[1]),
            field_of_view=_number(settings, _VIEW) if _BEARINGS not in settings and _FIRST not in settings else None,
            odometry=_three(table, ODOMETRY),
            stamps=table.columns.get(STAMP),
            truth=_three(table, TRUTH),
            range_min=shortest if range_min is None else range_min,
            range_max=_least(longest, range_max),
            T_robot_laser=_mount(settings),
            sweep=_number(settings, _SWEEP),
            gyro=_three(table, GYRO),
            path=path,
        )
    except ScanError as error:
        raise LogError(f"{path}: {error}") from error


def _mount(settings: Mapping[str, Sequence[float]]) -> list[float] | None:
    """Where the laser sits, what is not said of it zero; None where nothing is said."""
    stated = [_number(settings, name) for name in _MOUNT]
    return None if all(number is None for number in stated) else [number or 0.0 for number in stated]


def table_of(log: Log) -> ScanTable:
    """The table that holds all of a log."""
    geometry = log.geometry
    mount = zip(_MOUNT, geometry.T_robot_laser.tolist(), strict=True) if log.is_mount_known else ()
    settings = {
        _BEARINGS: geometry.bearings.tolist(),
        _LIMITS[0]: [geometry.range_min],
        _LIMITS[1]: [_beyond(log)],
        **{name: [value] for name, value in mount},
        **({} if log.sweep is None else {_SWEEP: [log.sweep]}),
    }
    columns = {STAMP: log.stamps}
    if log.has_odometry:
        columns |= dict(zip(ODOMETRY, log.odometry.T, strict=True))
    if log.truth is not None:
        columns |= dict(zip(TRUTH, log.truth.T, strict=True))
    if log.gyro is not None:
        columns |= dict(zip(GYRO, log.gyro.T, strict=True))
    return ScanTable(settings=settings, columns=columns, ranges=log.ranges)


def _bearings(settings: Mapping[str, Sequence[float]], n_beams: int) -> NDArray[np.float64] | None:
    if _BEARINGS in settings:
        return np.array(settings[_BEARINGS])
    first, step = _number(settings, _FIRST), _number(settings, _STEP)
    if first is None and step is None and _VIEW in settings:
        return None
    if first is None or step is None:
        raise ScanError(f"found no directions of the beams, expected {_BEARINGS}, {_FIRST} and {_STEP}, or {_VIEW}")
    return np.asarray(first + step * np.arange(n_beams), dtype=np.float64)


def _number(settings: Mapping[str, Sequence[float]], name: str) -> float | None:
    values = settings.get(name)
    if values is None:
        return None
    if len(values) != 1:
        raise ScanError(f"found {len(values)} numbers for {name}, expected one")
    return float(values[0])


def _least(stated: float | None, asked: float | None) -> float | None:
    given = [value for value in (stated, asked) if value is not None]
    return min(given) if given else None


def _three(table: ScanTable, names: tuple[str, ...]) -> NDArray[np.float64] | None:
    present = [name for name in names if name in table.columns]
    if not present:
        return None
    if len(present) < len(names):
        raise ScanError(f"found the columns {', '.join(present)}, expected all of {', '.join(names)}")
    return np.column_stack([table.columns[name] for name in names])


def _beyond(log: Log) -> float:
    """The least length that is no return: no reading reaches it."""
    longest = float(np.fmax.reduce(log.ranges, axis=None, initial=0.0))
    limit = np.float32(max(log.geometry.range_max, longest))
    return float(np.nextafter(limit, np.float32(math.inf)))
