"""Rows of figures as a table for people and as CSV."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from graph.atomic import write_atomically
from graph.file_names import readable

Figure = float | int | str | None
Row = dict[str, Figure]

_DECIMALS = {"m": 4, "°": 3, "s": 2, "ms": 3, "MB": 0, "%": 2}
"""Decimals by the unit in brackets at the end of a column's name."""


def columns_of(rows: Sequence[Row]) -> list[str]:
    """All columns, in the order in which they first appear."""
    return list(dict.fromkeys(name for row in rows for name in row))


def format_markdown(rows: Sequence[Row]) -> str:
    """A table in Markdown, readable as plain text too; what is not there is left blank."""
    names = columns_of(rows)
    cells = [names, *([_format(row.get(name), name) for name in names] for row in rows)]
    widths = [max(len(line[k]) for line in cells) for k in range(len(names))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) + " |" for line in cells
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """All figures in full precision."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns_of(rows), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomically(path, readable(text.getvalue()).encode())


def _format(value: Figure, column: str) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, float):
        unit = column[column.rfind("[") + 1 : -1] if column.endswith("]") else ""
        return f"{value:.{_DECIMALS.get(unit, 2)}f}"
    return str(value)
