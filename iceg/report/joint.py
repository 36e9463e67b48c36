"""The joint covariance of the key poses for the page, which works out distances with it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from iceg.report.packing import packed
from iceg.run_result.distance import SNAP
from iceg.run_result.joint_covariance import JointCovariance
from iceg.run_result.run_summary import LaserSummary

_UPPER = np.triu_indices(3)


def joint_payload(joint: JointCovariance, laser: LaserSummary | None) -> Mapping[str, Any]:
    """The Cholesky factor of the information matrix, and what else `JointCovariance.variance` rests on.

    Args:
        joint: of the run.
        laser: its noise as `summary.json` has it; None for none.
    """
    factor = joint.factor
    return {
        "row_of": packed(factor.row_of, "i4"),
        "starts": packed(factor.starts, "i4"),
        "rows": packed(factor.rows, "i4" if len(factor.row_of) > np.iinfo(np.uint16).max else "u2"),
        "blocks": packed(factor.blocks, "f4"),
        "roots": packed(factor.roots, "f8"),
        "anchors": packed(joint.anchors, "i4"),
        "anchor_of": packed(joint.anchor_of, "i4"),
        "placements": packed(joint.placements[:, *_UPPER], "f4"),
        "excess": packed(joint.excess, "f4"),
        "displacements": [{"key": each.key, "variances": each.variances.tolist()} for each in joint.displacements],
        "laser": {"noise_m": 0.0, "noise_per_metre": 0.0} if laser is None else dict(laser),
        "snap_m": SNAP,
    }
