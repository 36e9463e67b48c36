"""Tables of scans as CSV, plain or compressed: `# name = numbers` for what holds for all, a line of names, the rows.

Fields are separated by commas, semicolons or tabs, as the line of names has them; decimals have a point.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs.errors import LogError, MalformedLineError
from frontends.logs.line_loop import LineTroubles, read_lines
from frontends.logs.text import Line
from frontends.logs.text_output import write_text_log
from frontends.scan import Log, ScanError
from frontends.tables.layout import (
    FINITE,
    RANGE,
    SETTINGS,
    ScanTable,
    is_known,
    is_range,
    log_of,
    may_be_table,
    meant,
    range_columns,
    table_of,
    unknown_columns,
)

_MOST_SHOWN = 40
_SEPARATORS = (",", ";", "\t")
_PADDING = ",;\t "
"""What spreadsheets put behind a line that has fewer fields than others."""


def is_csv(head: bytes) -> bool:
    """Whether a file that begins with `head` is a CSV table of scans, by its line of names, misspelt or not."""
    for line in head.split(b"\n"):
        if line.strip() and not line.startswith(b"#"):
            text = line.decode("utf-8", "replace")
            return may_be_table(_names(text, _separator(text)))
    return False


def read_csv(
    path: Path | str,
    *,
    laser: str = "front",
    range_min: float | None = None,
    range_max: float | None = None,
    skip_bad_lines: bool = False,
) -> Log:
    """Read a table of scans, see `layout`; an empty field is no return.

    Args:
        path: the table.
        laser: "front": a table knows no other.
        range_min: shortest return [m]; None for what the table states, else 2 cm.
        range_max: longest return [m]; None for what the table states, else it is told from the readings.
        skip_bad_lines: pass over malformed lines and count them.

    Raises:
        LogError: the file cannot be read, a line is malformed, or the numbers make no log.
    """
    path = Path(path)
    check_laser(path, laser)
    settings: dict[str, list[float]] = {}
    columns: _Columns | None = None
    rows: list[list[float]] = []
    troubles = LineTroubles()

    def read(line: Line) -> None:
        nonlocal columns
        text = line.text.decode("utf-8", "replace").strip(" \r")
        if text.startswith("#"):
            _read_setting(line.number, text, settings, troubles)
        elif text and columns is None:
            columns = _columns(path, line.number, text, troubles)
        elif text and columns is not None:
            rows.append(_row(text, columns))

    read_lines(path, read, troubles, skip_bad_lines=skip_bad_lines)
    if columns is None or not rows:
        raise LogError(f"{path}: no scan, expected a line of names and a row for each scan")
    log = log_of(path, _table(path, settings, columns, np.array(rows)), range_min, range_max)
    return replace(log, skipped_lines=troubles.skipped, warnings=(*troubles.told(), *log.warnings))


def check_laser(path: Path, laser: str) -> None:
    """Tables hold one laser.

    Raises:
        LogError: another one is asked for.
    """
    if laser != "front":
        raise LogError(f"{path}: no laser is called '{laser}': a table holds one, expected 'front'")


def write_csv(path: Path | str, log: Log) -> None:
    """Write a log as a table, compressed when `path` ends with .gz; reading it back gives the same numbers.

    Raises:
        LogError: the file cannot be written.
    """
    write_text_log(Path(path), _text(table_of(log)))


@dataclass(frozen=True, kw_only=True)
class _Columns:
    """What the line of names says.

    Attributes:
        separator: between fields.
        n: of fields in each row.
        places: of the columns that are part of the layout.
        names: of these.
        finite: of these, the places of those that hold a finite number in each row.
    """

    separator: str
    n: int
    places: list[int]
    names: list[str]
    finite: list[int]


def _read_setting(number: int, text: str, settings: dict[str, list[float]], troubles: LineTroubles) -> None:
    name, equals, value = text.lstrip("# ").rstrip(_PADDING).partition("=")
    if not equals or name.strip() not in SETTINGS:  # a comment
        like = meant(name.strip(), SETTINGS) if equals else None
        if like:
            troubles.warnings.append(f"line {number}: found {name.strip()}, which is left out: did you mean {like}?")
        return
    try:
        settings[name.strip()] = [float(number) for number in value.split()]
    except ValueError:
        expected = f"numbers for {name.strip()}{_with_a_point(value)}"
        raise MalformedLineError(f"'{value.strip()[:_MOST_SHOWN]}'", expected) from None


def _separator(names: str) -> str:
    """What stands between the fields of a table with this line of names, which holds none of them itself."""
    return max(_SEPARATORS, key=names.count)


def _names(text: str, separator: str) -> list[str]:
    return [name.strip().strip('"') for name in text.split(separator)]


def _columns(path: Path, number: int, text: str, troubles: LineTroubles) -> _Columns:
    """Read the line of names, without which no row can be read.

    Raises:
        LogError: a name is misspelt, or stands there twice.
    """
    separator = _separator(text)
    names = _names(text, separator)
    places = [place for place, name in enumerate(names) if is_known(name)]
    known = [names[place] for place in places]
    twice = next((name for name, n in Counter(known).items() if n > 1), None)
    if twice is not None:
        raise LogError(f"{path}:{number}: found the column '{twice}' twice, expected each once")
    try:
        troubles.warnings += unknown_columns(names)
    except ScanError as error:
        raise LogError(f"{path}:{number}: {error}") from error
    finite = [place for place, name in enumerate(known) if name in FINITE]
    return _Columns(separator=separator, n=len(names), places=places, names=known, finite=finite)


def _row(text: str, columns: _Columns) -> list[float]:
    fields = text.split(columns.separator)
    if len(fields) != columns.n:
        raise MalformedLineError(f"{len(fields)} fields", f"{columns.n}, as many as names")
    if len(columns.places) < columns.n:
        fields = [fields[place] for place in columns.places]
    try:
        row = [float(field) if field.strip() else np.nan for field in fields]
    except ValueError as error:
        found = str(error).rpartition(": ")[2]
        raise MalformedLineError(found[:_MOST_SHOWN], f"a number{_with_a_point(found)}") from None
    for place in columns.finite:
        if not math.isfinite(row[place]):
            raise MalformedLineError(f"'{fields[place].strip()}' for {columns.names[place]}", "a finite number")
    return row


def _with_a_point(found: str) -> str:
    """What to say of numbers that have a comma in the place of a point."""
    return " with a point before the decimals, not a comma" if "," in found else ""


def _table(path: Path, settings: dict[str, list[float]], columns: _Columns, rows: NDArray[np.float64]) -> ScanTable:
    at = {name: place for place, name in enumerate(columns.names)}
    with np.errstate(over="ignore"):  # what no float32 can hold is no return
        ranges = rows[:, [at[name] for name in range_columns(path, columns.names)]].astype(np.float32)
    others = {name: rows[:, place] for name, place in at.items() if not is_range(name)}
    return ScanTable(settings=settings, columns=others, ranges=ranges)


def _text(table: ScanTable) -> Iterator[str]:
    yield "# A table of scans: ranges in metres, an empty field is no return, angles in radians.\n"
    for name, values in table.settings.items():
        yield f"# {name} = {' '.join(map(repr, values))}\n"
    n_beams = table.ranges.shape[1]
    yield ",".join([*table.columns, *(f"{RANGE}{beam}" for beam in range(n_beams))]) + "\n"
    for index, ranges in enumerate(table.ranges):
        poses = [repr(float(column[index])) for column in table.columns.values()]
        readings = ["" if reading == "nan" else reading for reading in ranges.astype(str).tolist()]
        yield ",".join([*poses, *readings]) + "\n"
