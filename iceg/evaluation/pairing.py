"""Which pose of a trajectory belongs to which true pose: by scan, or by stamp."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.trajectory import check_one_row_per_scan, poses_of_scans
from iceg.evaluation.truth import Truth
from iceg.tum import Trajectory

By = Literal["scan", "stamp"]
_TOLERANCE_S = 0.02
"""Stamps so far apart are not of one moment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pairing:
    """n pairs of poses.

    Attributes:
        by: how they were paired.
        scans: (n,) scan of each.
        T_world_robot: (n, 3) their true poses.
        matched: share of the rows of the truth that found a partner; of the scans, where the truth is the denser.
    """

    by: By
    scans: NDArray[np.int64]
    T_world_robot: NDArray[np.float64]
    matched: float


def pair(trajectory: Trajectory, truth: Truth, by: By | None = None) -> Pairing:
    """Pair a trajectory with the truth.

    Args:
        trajectory: one row per scan, in file order.
        truth: what is true.
        by: "scan": row by row, or as the truth names scans; "stamp": see `nearest_by_stamp`; left out: by scan where
            the truth names scans or has as many rows as the trajectory, else by stamp.

    Raises:
        EvaluationError: they cannot be paired in this way.
    """
    if by is None:
        by = "scan" if truth.scans is not None or len(truth) == len(trajectory) else "stamp"
    if by == "scan":
        return _by_scan(trajectory, truth)
    if truth.stamps is None:
        raise EvaluationError(f"{truth.path}: names scans and has no stamps, expected stamps to pair by")
    scans, rows = nearest_by_stamp(trajectory.stamps, truth.stamps)
    if len(scans) < 2:
        raise EvaluationError(
            f"{truth.path}: holds {len(truth)} poses, the trajectory {len(trajectory)}; {len(scans)} have stamps "
            f"within {_TOLERANCE_S:g} s of each other, expected at least 2, or one row per scan; the stamps run "
            f"from {truth.stamps.min():.3f} to {truth.stamps.max():.3f}, the trajectory's from "
            f"{trajectory.stamps.min():.3f} to {trajectory.stamps.max():.3f}"
        )
    matched = len(scans) / min(len(truth), len(trajectory))
    return Pairing(by="stamp", scans=scans, T_world_robot=truth.poses[rows], matched=matched)


def nearest_by_stamp(
    stamps: NDArray[np.float64], true_stamps: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For each stamp of the shorter list, the nearest of the longer; none where that is 20 ms away or more.

    That is evo's rule. Of two just as near, the earlier counts, and of equal stamps the first in file order.

    Args:
        stamps: (n,) of the trajectory [s], in file order; may step back.
        true_stamps: (m,) of the truth [s], likewise.

    Returns:
        Scans and rows of the truth, (k,) each, k ≤ min(n, m), in the order of the shorter list.
    """
    if len(true_stamps) <= len(stamps):
        rows, scans = _nearest(true_stamps, stamps)
        return scans, rows
    return _nearest(stamps, true_stamps)


def _nearest(queries: NDArray[np.float64], stamps: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of the queries that have a partner, and of their partners."""
    order = np.argsort(stamps, kind="stable")
    ordered = np.concatenate([[-np.inf], stamps[order], [np.inf]])
    after = np.searchsorted(ordered[1:-1], queries) + 1
    nearest = np.where(ordered[after] - queries < queries - ordered[after - 1], after, after - 1)
    found = np.abs(ordered[nearest] - queries) < _TOLERANCE_S
    return np.flatnonzero(found), order[nearest[found] - 1]


def _by_scan(trajectory: Trajectory, truth: Truth) -> Pairing:
    if truth.scans is None:
        check_one_row_per_scan(trajectory.poses, truth.poses, truth.path)
        scans = np.arange(len(trajectory))
    else:
        if len(truth) < 2:
            raise EvaluationError(f"{truth.path}: found 1 pose to compare, an alignment needs at least 2")
        poses_of_scans(trajectory.poses, truth.scans, truth.path)
        scans = truth.scans
    return Pairing(by="scan", scans=scans, T_world_robot=truth.poses, matched=1.0)
