"""Which closures only one of two runs has, and what the other says of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from iceg.slam.closures.closure import Closure

_NEXT = 1
"""Closures are the same if both their scans lie no more key poses apart than this."""
_MOST_WORDS = 160


@dataclass(frozen=True, slots=True, kw_only=True)
class LoneClosure:
    """A closure that was accepted in one run and not in the other.

    Attributes:
        only_in: the run that has it.
        scan_i: its earlier scan.
        scan_j: its later scan.
        elsewhere: what the other run says of it.
    """

    only_in: Literal["A", "B"]
    scan_i: int
    scan_j: int
    elsewhere: str


def lone_closures(
    a: Sequence[Closure], b: Sequence[Closure], key_scans: NDArray[np.int64]
) -> tuple[list[LoneClosure], int]:
    """Compare the closures accepted in two runs.

    Args:
        a: all tried in run A …
        b: … and in run B.
        key_scans: (k,) of run A, which tell how near two closures are.

    Returns:
        Those that only one run has, by their scans, and how many both have.
    """
    of_a, of_b = _Tried(a, key_scans), _Tried(b, key_scans)
    lone = [*of_a.missing_in(of_b, "A"), *of_b.missing_in(of_a, "B")]
    shared = len(of_a.accepted) - sum(one.only_in == "A" for one in lone)
    return sorted(lone, key=lambda one: (one.scan_i, one.scan_j, one.only_in)), shared


class _Tried:
    """The closures of one run, and between which key poses of run A they lie."""

    def __init__(self, closures: Sequence[Closure], key_scans: NDArray[np.int64]) -> None:
        self.accepted = [closure for closure in closures if closure.verdict == "accepted"]
        self.others = [closure for closure in closures if closure.verdict != "accepted"]
        self._key_scans = key_scans
        self.places = self._between(self.accepted)

    def missing_in(self, other: "_Tried", name: Literal["A", "B"]) -> list[LoneClosure]:
        """Those accepted here and not there."""
        refused = other._between(other.others)  # noqa: SLF001 of the same class
        lone = []
        for closure, place in zip(self.accepted, self.places, strict=True):
            if _near(place, other.places).any():
                continue
            found = np.flatnonzero(_near(place, refused))
            said = "not tried"
            if len(found):
                there = other.others[found[0]]
                said = f"{there.verdict}: {there.reason}"[:_MOST_WORDS]
            lone.append(LoneClosure(only_in=name, scan_i=closure.scan_i, scan_j=closure.scan_j, elsewhere=said))
        return lone

    def _between(self, closures: list[Closure]) -> NDArray[np.int64]:
        scans = np.array([(closure.scan_i, closure.scan_j) for closure in closures], dtype=np.int64).reshape(-1, 2)
        return np.searchsorted(self._key_scans, scans, side="right")


def _near(place: NDArray[np.int64], places: NDArray[np.int64]) -> NDArray[np.bool_]:
    near: NDArray[np.bool_] = np.abs(places - place).max(axis=1, initial=0) <= _NEXT
    return near
