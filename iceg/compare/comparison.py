"""Where two runs of one log differ, by how much, and whether that is more than both claim to know."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graph import dense
from graph.errors import IcegError
from graph.se2 import between, compose, inverse, logmap
from iceg.compare.closure_difference import LoneClosure, lone_closures
from iceg.run_folder import RunFolder

BEYOND = math.sqrt(11.345)
"""Differences of more standard deviations are beyond what both runs claim: 99 % of χ² with three degrees of freedom."""
_LEAST_VARIANCE = 1e-12
"""Added to both runs' variances, which are 0 at the first pose [m², rad²]."""


class CompareError(IcegError):
    """Two runs that cannot be compared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """Scans in a row at which two runs differ beyond what both claim.

    Attributes:
        first_scan: where it begins.
        last_scan: where it ends.
        distance: the largest in it [m].
        turn: the largest between the headings in it [rad].
        sigmas: the most in it.
        worst_scan: where that is.
    """

    first_scan: int
    last_scan: int
    distance: float
    turn: float
    sigmas: float
    worst_scan: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Run B against run A, both laid on their first pose.

    Attributes:
        scans: (k,) the key scans of A, at which they are compared.
        distances: (k,) between the positions [m].
        turns: (k,) absolute difference of the headings [rad].
        sigmas: (k,) Mahalanobis distance of the poses under the sum of both covariances.
        intervals: where they differ beyond what both claim, the worst first.
        lone_closures: which only one has.
        shared_closures: how many both have.
        mean_distance: over all scans [m].
        largest_distance: over all scans [m].
    """

    scans: NDArray[np.int64]
    distances: NDArray[np.float64]
    turns: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    intervals: list[Interval]
    lone_closures: list[LoneClosure]
    shared_closures: int
    mean_distance: float
    largest_distance: float

    def record(self) -> dict[str, Any]:
        """All but the curves, in types that JSON has; lengths in metres, angles in radians."""
        return {
            "scans": int(self.scans[-1]) + 1 if len(self.scans) else 0,
            "mean_distance_m": self.mean_distance,
            "largest_distance_m": self.largest_distance,
            "largest_turn_rad": float(self.turns.max(initial=0.0)),
            "share_beyond_99": float((self.sigmas > BEYOND).mean()),
            "most_sigmas": float(self.sigmas.max(initial=0.0)),
            "intervals": [asdict(interval) for interval in self.intervals],
            "shared_closures": self.shared_closures,
            "lone_closures": [asdict(closure) for closure in self.lone_closures],
        }


def compare_runs(a: RunFolder, b: RunFolder) -> Comparison:
    """Compare two runs of the same log by the number of the scan.

    The covariances are added as if the runs were independent; they rest on the same scans, so that real differences may
    be more telling than their σ.

    Args:
        a: one run.
        b: another; its map is laid over that of A by the first pose.

    Raises:
        CompareError: they have different numbers of scans.
    """
    if len(a.trajectory) != len(b.trajectory):
        raise CompareError(
            f"found runs of {len(a.trajectory)} and {len(b.trajectory)} scans, expected two runs of the same log"
        )
    of_a, of_b = a.trajectory.poses, compose(frame_of_b(a, b), b.trajectory.poses)
    scans = a.key_scans
    difference = logmap(between(of_a[scans], of_b[scans]))
    latest = np.maximum(np.searchsorted(b.key_scans, scans, side="right") - 1, 0)
    sigmas = _sigmas(difference, a.covariances + b.covariances[latest])
    apart = np.hypot(*(of_b - of_a)[:, :2].T)
    distances, turns = apart[scans], np.abs(difference[:, 2])
    lone, shared = lone_closures(a.closures, b.closures, scans)
    return Comparison(
        scans=scans,
        distances=distances,
        turns=turns,
        sigmas=sigmas,
        intervals=_intervals(scans, distances, turns, sigmas),
        lone_closures=lone,
        shared_closures=shared,
        mean_distance=float(apart.mean()),
        largest_distance=float(apart.max()),
    )


def frame_of_b(a: RunFolder, b: RunFolder) -> NDArray[np.float64]:
    """(3,) T_mapA_mapB: the first pose is where both begin."""
    return compose(a.trajectory.poses[0], inverse(b.trajectory.poses[0]))


def _sigmas(difference: NDArray[np.float64], covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    whitened = dense.solve(covariances + _LEAST_VARIANCE * np.eye(3), difference[:, :, None])[:, :, 0]
    squares: NDArray[np.float64] = (difference * whitened).sum(axis=1)
    return np.sqrt(np.maximum(squares, 0.0))


def _intervals(
    scans: NDArray[np.int64], distances: NDArray[np.float64], turns: NDArray[np.float64], sigmas: NDArray[np.float64]
) -> list[Interval]:
    beyond = np.concatenate([[0], (sigmas > BEYOND).astype(np.int64), [0]])
    borders = np.flatnonzero(np.diff(beyond)).tolist()
    intervals = []
    for first, end in zip(borders[::2], borders[1::2], strict=True):
        worst = first + int(sigmas[first:end].argmax())
        intervals.append(
            Interval(
                first_scan=int(scans[first]),
                last_scan=int(scans[end - 1]),
                distance=float(distances[first:end].max()),
                turn=float(turns[first:end].max()),
                sigmas=float(sigmas[worst]),
                worst_scan=int(scans[worst]),
            )
        )
    return sorted(intervals, key=lambda interval: (-interval.sigmas, interval.first_scan))
