"""On which line of a TOML file a table or a key stands, which the parser of the standard library does not tell."""

import re

_STANDS_AT = re.compile(r"\(at line (\d+), column \d+\)")


def line_of(text: str, table: str, number: int = 0, key: str | None = None) -> int:
    """The line of a table, or of a key in it, counted from 1; of the nearest thing found where it is written otherwise.

    Args:
        text: TOML.
        table: name of a table, or of tables in an array.
        number: which of an array, counted from 0.
        key: in the table.
    """
    lines = text.splitlines()
    header = re.compile(rf"\s*\[\[?\s*[\"']?{re.escape(table)}[\"']?\s*\]\]?")
    starts = [at for at, line in enumerate(lines) if header.match(line)]
    if number >= len(starts):
        return 1 + _first(lines, 0, len(lines), table)
    start = starts[number]
    end = next((at for at in range(start + 1, len(lines)) if lines[at].lstrip().startswith("[")), len(lines))
    return 1 + (start if key is None else _first(lines, start, end, key))


def line_of_fault(message: str) -> int | None:
    """The line that the parser's message names."""
    found = _STANDS_AT.search(message)
    return None if found is None else int(found[1])


def _first(lines: list[str], start: int, end: int, key: str) -> int:
    """The first line that sets a key, `start` where none does."""
    sets = re.compile(rf"\s*[\"']?{re.escape(key)}[\"']?\s*[=.]")
    return next((at for at in range(start, end) if sets.match(lines[at])), start)
