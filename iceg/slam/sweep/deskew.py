"""Scans as a laser would see them that measures all its beams at once, in the middle of the sweep."""

from dataclasses import replace

import numpy as np

from frontends.scan import Log, ScanGeometry
from graph.arrays import Floats
from graph.se2 import adjoint, inverse
from iceg.slam.sweep import _deskew_kernels as kernels
from iceg.slam.sweep.motion import MotionWithin


def deskewed(log: Log, motion: MotionWithin, share: float) -> Log:
    """A log freed of the motion during each sweep.

    Args:
        log: as recorded.
        motion: (n_scans,) of the robot within each scan.
        share: the sweep in intervals from scan to scan, negative where the laser turns clockwise.

    Returns:
        The log with each return where it would be seen from the pose in the middle of the sweep, on the same bearings.
    """
    geometry = log.geometry
    velocity, change = in_laser_frame(motion, geometry)
    ranges = np.empty_like(log.ranges)
    kernels.deskew(log.ranges, geometry.bearings, velocity, change, share, geometry.is_full_circle, ranges)
    return replace(log, ranges=ranges, sweep=0.0)


def in_laser_frame(motion: MotionWithin, geometry: ScanGeometry) -> tuple[Floats, Floats]:
    """Velocity and change, (n, 3) each, of the laser instead of the robot."""
    to_laser = adjoint(inverse(geometry.T_robot_laser))
    return (motion.velocity[:, None, :] * to_laser).sum(axis=2), (motion.change[:, None, :] * to_laser).sum(axis=2)
