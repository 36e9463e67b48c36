"""What a person asks for in the page, as a table of `corrections.toml`."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from graph.limits import LIMITS
from iceg.corrections.corrections import CorrectionsError
from iceg.settings_file import shown_value

_MOST_SCANS = 2
WITHDRAW = "withdraw"
"""The edit that takes a closure by hand out again."""


def edit_block(kind: str, asked: Mapping[str, Any]) -> str:
    """The table that one edit adds.

    Args:
        kind: "forbid", "add", "drag" or "pin".
        asked: by the page: `scans`, two numbers; of "forbid" instead `between`, two intervals; of "add" and "drag" also
            `pose`, x [m], y [m] and heading [rad] of the second scan in the frame of the first.

    Raises:
        CorrectionsError: it is none of these, or lacks what it needs.
    """
    if kind not in EDITS:
        raise CorrectionsError(f"found the edit '{kind[:40]}', expected one of {', '.join(EDITS)}")
    return EDITS[kind](asked)


def withdrawn_scans(asked: Mapping[str, Any]) -> tuple[int, int]:
    """Which scans the closures by hand join that are to be taken out.

    Raises:
        CorrectionsError: `scans` are not two of them.
    """
    _scans(found := asked.get("scans"))
    assert isinstance(found, list)
    return found[0], found[1]


def _forbid(asked: Mapping[str, Any]) -> str:
    if "between" in asked:
        intervals = asked["between"]
        if not isinstance(intervals, list) or len(intervals) != _MOST_SCANS:
            raise CorrectionsError(f"between: found {shown_value(intervals)}, expected two intervals of scans")
        one, other = (_scans(interval, "between") for interval in intervals)
        return f"[[forbid]]\nbetween = [{one}, {other}]\n"
    return f"[[forbid]]\nscans = {_scans(asked.get('scans'))}\n"


def _add(asked: Mapping[str, Any]) -> str:
    pose = "" if asked.get("pose") is None else f"pose = {_pose(asked['pose'])}\n"
    return f"[[add]]\nscans = {_scans(asked.get('scans'))}\n{pose}"


def _drag(asked: Mapping[str, Any]) -> str:
    return f"[[add]]\nscans = {_scans(asked.get('scans'))}\npose = {_pose(asked.get('pose'))}\n"


def _pin(asked: Mapping[str, Any]) -> str:
    return f"[[pin]]\nscans = {_scans(asked.get('scans'))}\n"


EDITS: Mapping[str, Callable[[Mapping[str, Any]], str]] = {"forbid": _forbid, "add": _add, "drag": _drag, "pin": _pin}
"""By name."""


def _scans(found: object, name: str = "scans") -> str:
    if (
        not isinstance(found, list)
        or len(found) != _MOST_SCANS
        or not all(isinstance(scan, int) and not isinstance(scan, bool) and 0 <= scan <= LIMITS.scans for scan in found)
    ):
        raise CorrectionsError(f"{name}: found {shown_value(found)}, expected two scans counted from 0")
    return f"[{found[0]}, {found[1]}]"


def _pose(found: object) -> str:
    if (
        not isinstance(found, list)
        or len(found) != 3
        or not all(isinstance(number, int | float) and not isinstance(number, bool) for number in found)
        or not all(math.isfinite(number) and abs(number) <= LIMITS.coordinate for number in found)
    ):
        raise CorrectionsError(f"pose: found {shown_value(found)}, expected [x m, y m, heading rad]")
    return "[" + ", ".join(f"{number:.6f}" for number in found) + "]"
