"""Matches, and the reasons why there is none, as arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graph.limits import LIMITS
from graph.measurement import RelativePose
from iceg.findings_file.table import Table


def match_arrays(prefix: str, matches: Sequence[RelativePose | None]) -> dict[str, NDArray[Any]]:
    """The arrays of matches, each name beginning with a prefix."""
    there = [match for match in matches if match is not None]
    numbers = np.array([(match.score, match.overlap) for match in there]).reshape(-1, 2)
    weak = [direction for match in there for direction in match.weak_directions]
    return {
        f"{prefix}_is_there": np.array([match is not None for match in matches], dtype=np.bool_),
        f"{prefix}_T": np.array([match.T_ref_cur for match in there]).reshape(-1, 3),
        f"{prefix}_covariance": np.array([match.covariance for match in there]).reshape(-1, 3, 3),
        f"{prefix}_inliers": np.array([match.inliers for match in there], dtype=np.uint32),
        f"{prefix}_score_overlap": numbers,
        f"{prefix}_weak": np.array(weak, dtype=np.float64).reshape(-1, 3),
        f"{prefix}_n_weak": np.array([len(match.weak_directions) for match in there], dtype=np.uint8),
    }


def matches_of(table: Table, prefix: str, count: int) -> list[RelativePose | None]:
    """The matches again, so many with those that are not there.

    Raises:
        IcegError: the arrays make no matches.
    """
    is_there = table.flags(f"{prefix}_is_there", count)
    n = int(np.count_nonzero(is_there))
    poses = table.floats(f"{prefix}_T", n, 3)
    if (np.abs(poses) > LIMITS.coordinate).any():
        raise table.error(f"'{prefix}_T' holds poses beyond {LIMITS.coordinate:g} m")
    covariances = table.floats(f"{prefix}_covariance", n, 3, 3)
    inliers = table.whole(f"{prefix}_inliers", n, high=LIMITS.beams + 1).tolist()
    numbers = table.floats(f"{prefix}_score_overlap", n, 2).tolist()
    ends = np.cumsum(table.whole(f"{prefix}_n_weak", n, high=4))
    weak = np.split(table.floats(f"{prefix}_weak", int(ends[-1]) if n else 0, 3), ends[:-1]) if n else []
    found = iter(
        [
            RelativePose(
                T_ref_cur=poses[k],
                covariance=covariances[k],
                score=numbers[k][0],
                inliers=inliers[k],
                overlap=numbers[k][1],
                weak_directions=weak[k],
            )
            for k in range(n)
        ]
    )
    return [next(found) if there else None for there in is_there.tolist()]
