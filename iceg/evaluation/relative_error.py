"""Relative pose error: how far a trajectory is off over so many metres, or so many seconds.

Sturm et al., *A Benchmark for the Evaluation of RGB-D SLAM Systems*, IROS 2012, section IV.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graph.se2 import between

_SLACK = 1.25
"""A pair counts whose poses lie no more than this factor farther apart than asked for: truth may have gaps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RelativeError:
    """What is left between the motions of an estimate and of the truth over one separation; NaN without any pair.

    Attributes:
        n: pairs of poses.
        translation_rmse: [m].
        rotation_rmse: [rad].
    """

    n: int
    translation_rmse: float
    rotation_rmse: float


def relative_error(
    estimated: NDArray[np.float64], true: NDArray[np.float64], along: NDArray[np.float64], separation: float
) -> RelativeError:
    """The error of all motions over one separation.

    From each pose to the first that is at least `separation` farther along, and no more than a quarter beyond that.

    Args:
        estimated: (n, 3) T_map_robot.
        true: (n, 3) T_world_robot of the same moments, in any frame.
        along: (n,) non-decreasing: metres of path, see `path_lengths`, or seconds.
        separation: in the same unit.
    """
    ends = np.searchsorted(along, along + separation * (1.0 - 1e-9))
    starts = np.flatnonzero(ends < len(along))
    starts = starts[along[ends[starts]] - along[starts] <= _SLACK * separation]
    ends = ends[starts]
    if len(starts) == 0:
        return RelativeError(n=0, translation_rmse=np.nan, rotation_rmse=np.nan)
    error = between(between(true[starts], true[ends]), between(estimated[starts], estimated[ends]))
    return RelativeError(
        n=len(error),
        translation_rmse=float(np.sqrt((error[:, :2] ** 2).sum(axis=1).mean())),
        rotation_rmse=float(np.sqrt((error[:, 2] ** 2).mean())),
    )


def path_lengths(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) metres driven up to each of (n, 3) poses."""
    steps = np.diff(poses[:, :2], axis=0)
    return np.concatenate([[0.0], np.hypot(steps[:, 0], steps[:, 1]).cumsum()])
