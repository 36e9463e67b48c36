"""Tables of numbers in text files."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graph.errors import IcegError, reason


class TableError(IcegError):
    """A table that cannot be read or does not hold what it should."""


def read_csv_table(path: Path, columns: Sequence[str]) -> NDArray[np.float64]:
    """Read a CSV of numbers whose header must name exactly these columns.

    Args:
        path: the file.
        columns: the expected header, in order.

    Returns:
        (n, len(columns)), n ≥ 1.

    Raises:
        TableError: naming the file and line, what was found and what was expected.
    """
    rows = []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            header = [word.strip() for word in next(reader, [])]
            if header != list(columns):
                raise TableError(
                    f"{path}:1: found the header '{','.join(header)[:80]}', expected '{','.join(columns)}'"
                )
            rows = [parse_numbers(row, columns, f"{path}:{reader.line_num}") for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as err:
        raise TableError(f"{path}: cannot be read as a CSV: {reason(err)}") from err
    if not rows:
        raise TableError(f"{path}: holds no rows under its header '{','.join(columns)}'")
    return np.array(rows)


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
    rows = []
    try:
        with path.open(encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                words = line.split()
                if words and not words[0].startswith("#"):
                    rows.append(parse_numbers(words, columns, f"{path}:{number}"))
    except (OSError, UnicodeDecodeError) as err:
        raise TableError(f"{path}: cannot be read as text: {reason(err)}") from err
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
    if not np.isfinite(values).all():
        raise TableError(f"{where}: found '{' '.join(words)}', expected finite numbers")
    return values


def first_that_is_no_number(words: Sequence[str]) -> str:
    """For messages: the first word that cannot be read as a number; there is one."""

    def is_number(word: str) -> bool:
        try:
            float(word)
        except ValueError:
            return False
        return True

    return next(word for word in words if not is_number(word))
