"""The record of a loop closure that was tried, whatever became of it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from graph.arrays import Floats, Ints
from graph.se2 import between
from graph.short_repr import short_repr
from iceg.slam.agreement import Tolerance, is_small
from iceg.slam.closures.attempt import Attempt, Verdict

CLOSURE_COLUMNS = ("scan_i", "scan_j", "x_m", "y_m", "theta_rad", "score", "inliers", "overlap", "verdict", "reason")
"""Of `closures.csv`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rival:
    """The best of the other places that a wide search found.

    Attributes:
        misfit: of the other place, see `Place` …
        own: … and of the one that the closure says, by the same search.
        apart: how far one is from the other [m].
    """

    misfit: float
    own: float
    apart: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Closure:
    """A place seen again, or what looked like it.

    Attributes:
        scan_i: the earlier scan.
        scan_j: the later scan.
        T_i_j: (3,) pose of scan j in the frame of scan i: x [m], y [m], heading [rad]; NaN where nothing was found.
        score: correlation score in [0, 1].
        inliers: how many beams agreed.
        overlap: share of the usable beams that fell on known reference, in [0, 1].
        verdict: what became of it.
        reason: why, in a sentence for a person.
        off_path: how far off the path it was when it was judged on the way, in standard deviations, at most; NaN where
            it was not, or where the closure was read back.
        rival: the best other place, where a wide search found some; None where the closure was read back.
    """

    scan_i: int
    scan_j: int
    T_i_j: Floats
    score: float
    inliers: int
    overlap: float
    verdict: Verdict
    reason: str
    off_path: float = math.nan
    rival: Rival | None = None

    __repr__ = short_repr


def joined_scans(closures: Iterable[Closure]) -> Ints:
    """(c, 2) earlier and later scan of each closure that was accepted."""
    accepted = [(closure.scan_i, closure.scan_j) for closure in closures if closure.verdict is Verdict.ACCEPTED]
    return np.array(accepted, dtype=np.int64).reshape(-1, 2)


def best_rival(attempt: Attempt, one_place: Tolerance) -> Rival | None:
    """The other place that a closure's later key scan fits best; None where no search found one."""
    if attempt.match is None:
        return None
    T_match_place = [between(attempt.match.T_ref_cur, place.T_old_new) for place in attempt.places]
    own = [p.misfit for p, T in zip(attempt.places, T_match_place, strict=True) if is_small(T, one_place)]
    others = [
        (p.misfit, float(np.hypot(T[0], T[1])))
        for p, T in zip(attempt.places, T_match_place, strict=True)
        if not is_small(T, one_place)
    ]
    if not own or not others:
        return None
    misfit, apart = min(others)
    return Rival(misfit=misfit, own=min(own), apart=apart)
