"""The record of a loop closure that was tried, whatever became of it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iceg.slam.closures.attempt import Verdict
from iceg.slam.closures.rival import Rival

CLOSURE_COLUMNS = ("scan_i", "scan_j", "x_m", "y_m", "theta_rad", "score", "inliers", "overlap", "verdict", "reason")
"""Of `closures.csv`."""


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
    T_i_j: NDArray[np.float64]
    score: float
    inliers: int
    overlap: float
    verdict: Verdict
    reason: str
    off_path: float = math.nan
    rival: Rival | None = None


def joined_scans(closures: Iterable[Closure]) -> NDArray[np.int64]:
    """(c, 2) earlier and later scan of each closure that was accepted."""
    accepted = [(closure.scan_i, closure.scan_j) for closure in closures if closure.verdict is Verdict.ACCEPTED]
    return np.array(accepted, dtype=np.int64).reshape(-1, 2)
