"""The arrays on which the compiled loops of the feature map work."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I8 = NDArray[np.int8]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

CORNER, END_OF_WALL, INTERSECTION = 0, 1, 2


class Store(NamedTuple):
    """The landmarks as growing arrays, each landmark in the frame of its anchor."""

    anchors: I64
    kinds: I8
    positions: F64
    directions: F64
    covariances: F64
    direction_variances: F64
    distances: F64
    existence: F64  # log-odds
    first_seen: I64
    last_seen: I64
    seen: I64
    missed: I64
    expired_at: I64


class Observed(NamedTuple):
    """The features of one key scan, robot frame, and the scan itself."""

    kinds: I8
    positions: F64
    directions: F64
    covariances: F64
    direction_variances: F64
    distances: F64
    real: Bool
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
