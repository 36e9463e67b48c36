"""What changes along the path: curves of the report of a run, one value a key pose."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graph.dense import eigvalsh
from graph.se2 import between, compose
from iceg.report.explained import explained_shares
from iceg.report.packing import packed

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult


def curves_payload(result: "SlamResult", shares: NDArray[np.float64]) -> Mapping[str, Any]:
    """Uncertainty, odometry against the path, and how much of each scan the map explains.

    Args:
        result: of the run.
        shares: (k,) see `shares_of`.
    """
    position = np.sqrt(eigvalsh(result.covariances[:, :2, :2])[:, 1].clip(min=0.0))
    heading = np.sqrt(result.covariances[:, 2, 2].clip(min=0.0))
    curves: dict[str, Any] = {
        "position_sigma": packed(position, "f4"),
        "heading_sigma": packed(np.degrees(heading), "f4"),
        "explained": packed(shares, "f4"),
    }
    if result.log.has_odometry:
        guided = guided_by_odometry(result)
        off = between(result.key_poses, guided)
        curves["odometry_off"] = packed(np.hypot(off[:, 0], off[:, 1]), "f4")
        curves["odometry_turn"] = packed(np.degrees(np.unwrap(off[:, 2])), "f4")
        curves["odometry_path"] = packed(guided[:, :2], "f4")
    return curves


def shares_of(result: "SlamResult") -> NDArray[np.float64]:
    """(k,) share of the returns of each key scan that the map explains."""
    return explained_shares(result.log, result.key_scans, result.key_poses, result.grid)


def guided_by_odometry(result: "SlamResult") -> NDArray[np.float64]:
    """(k, 3) where the recorded odometry alone would put the key poses, the first where it is."""
    odometry = result.log.odometry[result.key_scans]
    return compose(result.key_poses[0], between(odometry[0], odometry))
