"""Tables of numbers in text files."""

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from graph.errors import IcegError, reason
from graph.files import check_file
from graph.limits import LIMITS, at_most

_VARIANCES = {"xx", "xy", "xtheta", "yy", "ytheta", "thetatheta"}


class TableError(IcegError):
    """A table that cannot be read or does not hold what it should."""


@contextmanager
def open_table(path: Path, error: type[IcegError], what: str, encoding: str = "utf-8") -> Iterator[TextIO]:
    """A text file of rows, open for reading; whatever breaks its encoding or cannot be read ends in one error.

    Args:
        path: the file.
        error: raised where it cannot be read, or is too large.
        what: for the message: "cannot be read as" what.
        encoding: of its text.

    Raises:
        IcegError: of the type given.
    """
    check_file(path, "table_bytes", error, what)
    try:
        with path.open(encoding=encoding, newline="") as file:
            yield file
    except (OSError, UnicodeDecodeError, csv.Error) as err:
        raise error(f"{path}: cannot be read as {what}: {reason(err)}") from err


def check_row(number: int, where: str, error: type[IcegError]) -> None:
    """Refuse a table that has more rows than allowed.

    Raises:
        IcegError: of the type given.
    """
    if number > LIMITS.rows:
        raise error(f"{where}: found more rows, expected {at_most('rows')}")


def read_csv_table(path: Path, columns: Sequence[str], *, may_be_empty: bool = False) -> NDArray[np.float64]:
    """Read a CSV of numbers whose header must name exactly these columns.

    Args:
        path: the file.
        columns: the expected header, in order.
        may_be_empty: whether there may be a header alone.

    Returns:
        (n, len(columns)), n ≥ 1 unless there may be none.

    Raises:
        TableError: naming the file and line, what was found and what was expected.
    """
    rows: list[list[float]] = []
    with open_table(path, TableError, "a CSV", "utf-8-sig") as file:
        reader = csv.reader(file)
        header = [word.strip() for word in next(reader, [])]
        if header != list(columns):
            raise TableError(f"{path}:1: found the header '{','.join(header)[:80]}', expected '{','.join(columns)}'")
        for row in filter(None, reader):
            check_row(len(rows) + 1, f"{path}:{reader.line_num}", TableError)
            rows.append(parse_numbers(row, columns, f"{path}:{reader.line_num}"))
    if not rows and not may_be_empty:
        raise TableError(f"{path}: holds no rows under its header '{','.join(columns)}'")
    return np.array(rows).reshape(-1, len(columns))


def read_blank_separated_table(path: Path, columns: Sequence[str]) -> NDArray[np.float64]:
    """Read lines of numbers separated by blanks; lines starting with `#` are comments.

    Args:
        path: the file.
        columns: what the numbers of a line are, in order.

    Returns:
        (n, len(columns)), n ≥ 1.

    Raises:
        TableError: naming the file and line, what was found and what was expected.
    """
    rows: list[list[float]] = []
    with open_table(path, TableError, "text") as file:
        for number, line in enumerate(file, 1):
            words = line.split()
            if words and not words[0].startswith("#"):
                check_row(len(rows) + 1, f"{path}:{number}", TableError)
                rows.append(parse_numbers(words, columns, f"{path}:{number}"))
    if not rows:
        raise TableError(f"{path}: holds no rows, expected lines '{' '.join(columns)}'")
    return np.array(rows)


def parse_numbers(words: Sequence[str], columns: Sequence[str], where: str) -> list[float]:
    """The finite numbers of one row.

    Args:
        words: what the row holds.
        columns: what it should hold.
        where: file and line, for the message.

    Raises:
        TableError: another count, no number, or not finite.
    """
    expected = f"expected {len(columns)} numbers: {' '.join(columns)}"
    if len(words) != len(columns):
        raise TableError(f"{where}: found {len(words)} values, {expected}")
    try:
        values = [float(word) for word in words]
    except ValueError as err:
        raise TableError(f"{where}: found '{first_that_is_no_number(words)}', {expected}") from err
    for value, word, column in zip(values, words, columns, strict=True):
        most = _most(column)
        if not abs(value) <= most:
            raise TableError(f"{where}: found '{word[:40]}' for {column}, expected finite numbers of at most {most:g}")
    return values


def _most(column: str) -> float:
    """The greatest magnitude of a number, by the column it stands in."""
    if column in {"t_s", "stamp", "stamp_i", "stamp_j"}:
        return LIMITS.stamp
    if column.endswith(("theta_rad", "roll", "pitch", "yaw")):
        return LIMITS.heading
    return LIMITS.coordinate**2 if column in _VARIANCES else LIMITS.coordinate


def first_that_is_no_number(words: Sequence[str]) -> str:
    """For messages: the first word that cannot be read as a number; there is one."""

    def is_number(word: str) -> bool:
        try:
            float(word)
        except ValueError:
            return False
        return True

    return next(word for word in words if not is_number(word))[:80]
