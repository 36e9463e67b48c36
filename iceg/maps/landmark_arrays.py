"""The arrays on which the compiled loops of the feature map work."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Records = NDArray[np.record]
"""(n,) of a structured type below."""

CORNER, END_OF_WALL, INTERSECTION = 0, 1, 2


LANDMARK = np.dtype(
    [
        ("anchor", np.int64),
        ("kind", np.int8),
        ("position", np.float64, 2),
        ("directions", np.float64, 2),
        ("covariance", np.float64, (2, 2)),
        ("direction_variances", np.float64, 2),
        ("distance", np.float64),
        ("existence", np.float64),
        ("first_seen", np.int64),
        ("last_seen", np.int64),
        ("seen", np.int64),
        ("missed", np.int64),
        ("expired_at", np.int64),
    ],
    align=True,
)
"""One landmark, in the frame of its anchor; the evidence of its existence is in log-odds. As a record: for an array of
each field, handed from loop to loop, the loops take half as long again to compile."""
FEATURE = np.dtype(
    [
        ("kind", np.int8),
        ("position", np.float64, 2),
        ("directions", np.float64, 2),
        ("covariance", np.float64, (2, 2)),
        ("direction_variance", np.float64),
        ("distance", np.float64),
        ("real", np.bool_),
    ],
    align=True,
)
"""One feature of a scan, as in `Features`."""


class Observed(NamedTuple):
    """The features of one key scan, robot frame, and the scan itself."""

    features: Records
    ranges: F32
    bearings: F64
    T_robot_laser: F64


class Settings(NamedTuple):
    """What the kernels need of the configuration: variances, and evidence in log-odds."""

    gate: float
    max_distance: float
    max_angle: float
    pose_variance: float
    heading_variance: float
    drift_variance: float
    landmark_range: float
    landmark_variance: float
    visible_range: float
    occlusion_margin: float
    sin_edge_on: float
    seen_evidence: float
    missed_evidence: float
    highest_evidence: float
    expiry_evidence: float
