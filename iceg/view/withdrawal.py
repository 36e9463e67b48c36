"""Closures by hand taken out of the text of `corrections.toml`; all else stays as it is written."""

import re
from typing import Any

from iceg.corrections.corrections import CorrectionsError
from iceg.corrections.manual_closures import ManualClosure
from iceg.corrections.reading import parse_corrections

_HEADER = re.compile(r"\s*\[\[?\s*[A-Za-z_\"']")


def without_added(text: str, scans: tuple[int, int], where: str) -> str:
    """The text without the tables `[[add]]` that join two scans.

    Args:
        text: TOML.
        scans: in either order.
        where: the name of its source, for messages.

    Raises:
        CorrectionsError: there is no such closure, or it does not stand in a table of its own.
    """
    before = parse_corrections(text, where)
    gone = [closure for closure in before.added if _joins(closure, scans)]
    if not gone:
        raise CorrectionsError(f"{where}: found no closure by hand between scans {scans[0]} and {scans[1]}")
    lines = text.splitlines(keepends=True)
    for first in sorted((_header_of(closure, lines) for closure in gone), reverse=True):
        end = next((at for at in range(first + 1, len(lines)) if _HEADER.match(lines[at])), len(lines))
        del lines[first:end]
    left = "".join(lines)
    expected: dict[str, Any] = before.record()
    kept = [row for row in expected["added"] if set(row["scans"]) != set(scans)]
    expected = {**expected, "added": kept} if kept else {k: v for k, v in expected.items() if k != "added"}
    if parse_corrections(left, where).record() != expected:
        raise CorrectionsError(f"{gone[0].where}: found no table [[add]] of its own, expected one: take it out by hand")
    return left


def _joins(closure: ManualClosure, scans: tuple[int, int]) -> bool:
    return {closure.scan_i, closure.scan_j} == set(scans)


def _header_of(closure: ManualClosure, lines: list[str]) -> int:
    """The line, counted from 0, that its table begins with; its own where there is none."""
    own = int(closure.where.rpartition(":")[2]) - 1
    return next((at for at in range(own, -1, -1) if _HEADER.match(lines[at])), own)
