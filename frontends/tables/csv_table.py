"""Tables of scans as CSV, plain or compressed: `# name = numbers` for what holds for all, a line of names, the rows."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs.errors import LogError, MalformedLineError
from frontends.logs.line_loop import LineTroubles, read_lines
from frontends.logs.text import Line
from frontends.logs.text_output import write_text_log
from frontends.scan import Log
from frontends.tables.layout import (
    FINITE,
    RANGE,
    SETTINGS,
    STAMP,
    ScanTable,
    is_known,
    is_range,
    log_of,
    meant,
    range_columns,
    table_of,
)

_MOST_SHOWN = 40


def is_csv(head: bytes) -> bool:
    """Whether a file that begins with `head` is a CSV table of scans: its line of names holds a range."""
    for line in head.split(b"\n"):
        if line.strip() and not line.startswith(b"#"):
            names = line.decode("utf-8", "replace").split(",")
            return STAMP in names or any(is_range(name.strip()) for name in names)
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
    names: list[str] = []
    finite: list[int] = []
    rows: list[list[float]] = []
    troubles = LineTroubles()

    def read(line: Line) -> None:
        text = line.text.decode("utf-8", "replace").strip()
        if text.startswith("#"):
            _read_setting(line.number, text, settings, troubles)
        elif not names and text:
            names.extend(_names(text))
            finite.extend(place for place, name in enumerate(names) if name in FINITE)
        elif text:
            rows.append(_row(text, names, finite))

    read_lines(path, read, troubles, skip_bad_lines=skip_bad_lines)
    if not rows:
        raise LogError(f"{path}: no scan, expected a line of names and a row for each scan")
    log = log_of(path, _table(path, settings, names, np.array(rows)), range_min, range_max)
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


def _read_setting(number: int, text: str, settings: dict[str, list[float]], troubles: LineTroubles) -> None:
    name, equals, value = text.lstrip("# ").partition("=")
    if not equals or name.strip() not in SETTINGS:  # a comment
        like = meant(name.strip(), SETTINGS) if equals else None
        if like:
            troubles.warnings.append(f"line {number}: found {name.strip()}, which is left out: did you mean {like}?")
        return
    try:
        settings[name.strip()] = [float(number) for number in value.split()]
    except ValueError:
        raise MalformedLineError(f"'{value.strip()[:_MOST_SHOWN]}'", f"numbers for {name.strip()}") from None


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")]
    unknown = [name for name in names if not is_known(name)]
    if unknown:
        raise MalformedLineError(
            f"the column '{unknown[0][:_MOST_SHOWN]}'", f"stamp_s, odom_…, truth_…, gyro_… and {RANGE}…"
        )
    if len(set(names)) < len(names):
        raise MalformedLineError("a column twice", "each column once")
    return names


def _row(text: str, names: list[str], finite: list[int]) -> list[float]:
    fields = text.split(",")
    if len(fields) != len(names):
        raise MalformedLineError(f"{len(fields)} fields", f"{len(names)}, as many as names")
    try:
        row = [float(field) if field.strip() else np.nan for field in fields]
    except ValueError as error:
        raise MalformedLineError(str(error).rpartition(": ")[2][:_MOST_SHOWN], "a number") from None
    for place in finite:
        if not math.isfinite(row[place]):
            raise MalformedLineError(f"'{fields[place].strip()}' for {names[place]}", "a finite number")
    return row


def _table(path: Path, settings: dict[str, list[float]], names: list[str], rows: NDArray[np.float64]) -> ScanTable:
    at = {name: place for place, name in enumerate(names)}
    with np.errstate(over="ignore"):  # what no float32 can hold is no return
        ranges = rows[:, [at[name] for name in range_columns(path, names)]].astype(np.float32)
    columns = {name: rows[:, place] for name, place in at.items() if not is_range(name)}
    return ScanTable(settings=settings, columns=columns, ranges=ranges)


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
