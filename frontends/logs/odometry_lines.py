"""Odometry that a log keeps on lines of its own, brought to the scans by file order."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graph.se2 import wrap_angle


def at_scans(poses: Sequence[Sequence[float]], scans_before: Sequence[int], n_scans: int) -> NDArray[np.float64]:
    """Interpolate odometry at each scan.

    The m scans between two odometry lines divide the motion between them into m + 1 equal parts: file order is the
    only clock all logs have. Scans before the first line or after the last take that one.

    Args:
        poses: (n, 3) robot poses of the odometry lines, in file order.
        scans_before: (n,) how many scans stood in the file before each.
        n_scans: how many scans there are.

    Returns:
        (n_scans, 3) T_odom_robot; zeros when there is no odometry line.
    """
    if len(poses) == 0:
        return np.zeros((n_scans, 3))
    T_odom_robot = np.array(poses)
    T_odom_robot[:, 2] = np.unwrap(T_odom_robot[:, 2])
    positions = np.array(scans_before)
    scans = np.arange(n_scans)
    after = np.searchsorted(positions, scans, side="right")
    before = np.maximum(after - 1, 0)
    after = np.minimum(after, len(positions) - 1)
    between = np.maximum(positions[after] - positions[before], 0)
    share = np.where(after > before, (scans - positions[before] + 1) / (between + 1), 0.0)
    at_scan: NDArray[np.float64] = T_odom_robot[before] + share[:, None] * (T_odom_robot[after] - T_odom_robot[before])
    at_scan[:, 2] = wrap_angle(at_scan[:, 2])
    return at_scan
