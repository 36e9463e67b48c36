"""The error of a path and the honesty of its covariances, where the truth is known."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graph.se2 import compose, inverse
from iceg.evaluation.consistency import chi_square_quantiles, pose_nees
from iceg.evaluation.trajectory import align, trajectory_errors
from iceg.report.packing import packed

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult

_LEAST = 2


def truth_payload(result: "SlamResult", truth: NDArray[np.float64]) -> Mapping[str, Any] | None:
    """Error and NEES of each key pose, and the true path laid over the map; None where there is next to nothing.

    Args:
        result: of the run.
        truth: (n_scans, 3) true poses, in a frame of their own.
    """
    if len(result.key_scans) < _LEAST:
        return None
    errors = trajectory_errors(result.trajectory, truth)
    T_map_world = inverse(align(result.trajectory, truth))
    on_map = compose(T_map_world, truth)
    off = result.key_poses[:, :2] - on_map[result.key_scans, :2]
    nees = pose_nees(result.key_poses, truth[result.key_scans], result.covariances)
    low, high = chi_square_quantiles(np.array([0.025, 0.975]), 3)
    return {
        "path": packed(on_map[:, :2], "f4"),
        "error": packed(np.hypot(off[:, 0], off[:, 1]), "f4"),
        "nees": packed(np.concatenate([[math.nan], nees]), "f4"),
        "nees_bounds": [float(low), float(high)],
        "rmse_m": errors.ate_rmse,
        "max_m": errors.ate_max,
        "heading_rmse_deg": math.degrees(errors.rot_rmse),
        "nees_mean": float(nees.mean()),
    }
