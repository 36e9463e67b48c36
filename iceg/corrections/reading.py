"""Corrections from a file: `corrections.toml`, a run's `closures.csv` with other verdicts, or a CSV of closures."""

import csv
import re
from collections.abc import Iterable, Mapping
from functools import reduce
from pathlib import Path
from typing import Any, get_args

import numpy as np

from graph.files import read_text
from iceg.corrections.corrections import Corrections, CorrectionsError, GivenVerdict, VerdictWord
from iceg.corrections.manual_closures import read_manual_closures
from iceg.corrections.toml_entries import ENTRIES, SINGLE_ENTRIES
from iceg.corrections.toml_lines import line_of, line_of_fault
from iceg.settings_file import ConfigError, build_settings, parse_toml, shown_value
from iceg.slam.closures.closure import CLOSURE_COLUMNS
from iceg.tables import TableError, check_row, open_table, parse_numbers

_WORDS: tuple[VerdictWord, ...] = get_args(VerdictWord)
_CULPRIT = re.compile(r": (?:unknown key ')?(\w+)")


def read_corrections(path: Path | str) -> Corrections:
    """Read corrections; what the file begins with tells what it is.

    Args:
        path: a file as docs/corrections.md describes it, or a CSV that begins with `scan_i,scan_j`.

    Raises:
        IcegError: file and line, what was found and what was expected.
    """
    path = Path(path)
    head = _head(path)
    if not (_is_table(head) or path.suffix.lower() == ".csv"):
        return parse_corrections(read_text(path, "settings_bytes", CorrectionsError, "corrections"), str(path))
    if head == list(CLOSURE_COLUMNS):
        return Corrections(verdicts=_verdicts(path))
    return Corrections(added=tuple(read_manual_closures(path)))


def read_all_corrections(paths: Iterable[Path]) -> Corrections:
    """Those of several files together.

    Raises:
        IcegError: as `read_corrections`; or two of them cut the log, or turn the map.
    """
    return reduce(Corrections.joined, map(read_corrections, paths), Corrections())


def text_of_corrections(path: Path) -> str | None:
    """The text of `corrections.toml`, to be kept; None of a CSV.

    Raises:
        IcegError: the file cannot be read.
    """
    if _is_table(_head(path)):
        return None
    return read_text(path, "settings_bytes", CorrectionsError, "corrections")


def _head(path: Path) -> list[str]:
    """What stands between the commas of the first line."""
    with open_table(path, CorrectionsError, "corrections", "utf-8-sig") as file:
        return [word.strip() for word in file.readline(1000).split(",")]


def _is_table(head: list[str]) -> bool:
    return head[:2] == ["scan_i", "scan_j"]


def parse_corrections(text: str, where: str) -> Corrections:
    """Corrections from TOML.

    Args:
        text: TOML.
        where: the name of its source, for messages.

    Raises:
        CorrectionsError: source and line, what was found and what was expected.
    """
    try:
        tables = parse_toml(text, where, CorrectionsError)
    except CorrectionsError as err:
        line = line_of_fault(str(err))
        raise err if line is None else CorrectionsError(str(err).replace(where, f"{where}:{line}", 1)) from err
    known = (*ENTRIES, *SINGLE_ENTRIES)
    for name in tables:
        if name not in known:
            at = line_of(text, name)
            raise CorrectionsError(f"{where}:{at}: found '{name[:60]}', expected one of {', '.join(known)}")
    several = {name: _several(tables.get(name, []), name, text, where) for name in ENTRIES}
    single = {
        name: _built(kind, tables[name], text, where, (name, 0))
        for name, kind in SINGLE_ENTRIES.items()
        if name in tables
    }
    return Corrections(
        forbidden=several["forbid"],
        added=several["add"],
        pinned=several["pin"],
        distrusted=several["distrust"],
        **{{"cut": "cut", "map": "frame"}[name]: built for name, built in single.items()},
    )


def _several(entries: object, name: str, text: str, where: str) -> tuple[Any, ...]:
    if not isinstance(entries, list):
        at = line_of(text, name)
        raise CorrectionsError(f"{where}:{at}: {name}: found {shown_value(entries)}, expected tables [[{name}]]")
    return tuple(_built(ENTRIES[name], entry, text, where, (name, number)) for number, entry in enumerate(entries))


def _built(kind: Any, entry: object, text: str, source: str, place: tuple[str, int]) -> Any:  # noqa: ANN401
    """One table as what it asks for; errors name the line of the key that is at fault."""

    def at(key: str | None = None) -> str:
        return f"{source}:{line_of(text, *place, key)}"

    if not isinstance(entry, Mapping):
        raise CorrectionsError(f"{at()}: {place[0]}: found {shown_value(entry)}, expected a table")
    try:
        asked = build_settings(kind, entry, where="")
    except ConfigError as err:
        culprit = _CULPRIT.match(str(err))
        raise CorrectionsError(f"{at(None if culprit is None else culprit[1])}{err}") from err
    return asked.built(at)


def _verdicts(path: Path) -> tuple[GivenVerdict, ...]:
    """The rows of a run's record of closures."""
    rows: list[GivenVerdict] = []
    with open_table(path, TableError, "a CSV", "utf-8-sig") as file:
        reader = csv.reader(file)
        next(reader)
        for row in filter(None, reader):
            where = f"{path}:{reader.line_num}"
            check_row(len(rows) + 1, where, TableError)
            rows.append(_verdict(row, where))
    return tuple(rows)


def _verdict(row: list[str], where: str) -> GivenVerdict:
    if len(row) != len(CLOSURE_COLUMNS):
        raise TableError(f"{where}: found {len(row)} values, expected {len(CLOSURE_COLUMNS)}")
    word = row[CLOSURE_COLUMNS.index("verdict")].strip()
    if word not in _WORDS:
        raise CorrectionsError(f"{where}: found the verdict '{word[:40]}', expected one of {', '.join(_WORDS)}")
    scans = parse_numbers(row[:2], CLOSURE_COLUMNS[:2], where)
    if min(scans) < 0 or scans[0] == scans[1] or not all(scan.is_integer() for scan in scans):
        raise CorrectionsError(f"{where}: found scans {row[0]} and {row[1]}, expected two different ones from 0")
    has_pose = not any(word.strip().lower() == "nan" for word in row[2:5])
    return GivenVerdict(
        scan_i=int(scans[0]),
        scan_j=int(scans[1]),
        T_i_j=np.array(parse_numbers(row[2:5], CLOSURE_COLUMNS[2:5], where)) if has_pose else None,
        verdict=word,
        where=where,
    )
