"""What a run warns of: each place in a sentence, and all of a kind in one line for whoever looks at the terminal."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "lost",
    "new ground",
    "found again",
    "cut off",
    "drifted",
    "conflict",
    "doubtful",
    "perceptual aliasing",
    "odometry stands still",
    "uncertain path",
    "coarse grid",
    "covariances",
    "carried",
    "corrections",
    "gyro",
    "laser place",
]

_MANY: dict[Kind, str] = {
    "lost": "tracking was lost at {n} places, first at scan {scan}; loop closures tie what follows to the rest",
    "new ground": (
        "nothing known before matched at {n} places, first at scan {scan}; odometry tells how what follows lies"
    ),
    "found again": "tracking was lost at {n} places and the robot found again at each, first at scan {scan}",
    "cut off": (
        "tracking was lost at {n} places, first at scan {scan}, and no loop closure ties what follows to what was "
        "before: those parts of the map may be displaced"
    ),
    "drifted": (
        "the path drifted so far that its maps contradict each other at {n} places, first at scan {scan}; the map "
        "follows the scans"
    ),
    "conflict": (
        "match and odometry contradict each other at {n} places, first at scan {scan}, and loop closures do not settle "
        "it; the map follows the matches, and may be displaced from there on"
    ),
    "doubtful": (
        "the robot may have been carried at {n} places, first at scan {scan}, and loop closures do not settle whether "
        "it was: the map goes on as if not, and what follows may be displaced"
    ),
    "perceptual aliasing": (
        "several places fit {n} times (perceptual aliasing), first from scan {scan} on; no loop is closed there"
    ),
    "odometry stands still": (
        "the odometry stands still at {n} places while the scans change, first at scan {scan}; it is not believed there"
    ),
}
"""How several of a kind are told; of all other kinds there is one at most, but each correction is told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunWarning:
    """Something that a person should know about a result.

    Attributes:
        kind: warnings of one kind are told together.
        sentence: for a person who does not know the program.
        scan: the first scan concerned; None where it is about the whole run.
    """

    kind: Kind
    sentence: str
    scan: int | None = None


def in_short(warnings: Iterable[RunWarning], details: str) -> list[str]:
    """One line for each kind, in the order in which the kinds first come.

    Args:
        warnings: of a run.
        details: where each of them can be read.

    Returns:
        A sentence as it is where it is the only one of its kind, or about a correction; else how many there are, and
        where the first is.
    """
    kinds: dict[Kind, list[RunWarning]] = {}
    for warning in warnings:
        kinds.setdefault(warning.kind, []).append(warning)
    return [line for kind, same in kinds.items() for line in _lines(kind, same, details)]


def _lines(kind: Kind, same: Sequence[RunWarning], details: str) -> list[str]:
    if len(same) == 1 or kind not in _MANY:
        return [warning.sentence for warning in same]
    first = min(warning.scan for warning in same if warning.scan is not None)
    return [f"{_MANY[kind].format(n=len(same), scan=first)}; see {details}"]
