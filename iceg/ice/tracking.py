"""Scan after scan matched against one local map, from one key scan to the next, for as long as every match is plain."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.odometry import OdometryModel, OdometryMotion
from iceg.ice import _tracking_kernels as kernels
from iceg.ice._noise_kernels import RangeNoise
from iceg.ice._tracking_kernels import Limits, Polish
from iceg.ice.local_map import LocalMap
from iceg.ice.points import JUMP, ScanPoints

__all__ = ["Followed", "Limits", "Polish", "Standing", "follow_scans"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """Where a robot is, in the frame of a local map.

    Attributes:
        T_ref_robot: (3,) its pose at the last scan.
        T_ref_key: (3,) its pose at the last key scan.
        motion: odometry from there to here.
    """

    T_ref_robot: NDArray[np.float64]
    T_ref_key: NDArray[np.float64]
    motion: OdometryMotion


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """What became of a robot.

    Attributes:
        T_ref_robots: (n, 3) its poses at the scans followed.
        motion: odometry from the last key scan to the last of them.
        key_scan: the last of them and its points, if it is to become a key scan.
    """

    T_ref_robots: NDArray[np.float64]
    motion: OdometryMotion
    key_scan: tuple[Scan, ScanPoints] | None


def follow_scans(
    ranges: NDArray[np.float32],
    steps: NDArray[np.float64],
    geometry: ScanGeometry,
    local_map: LocalMap,
    standing: Standing,
    odometry: OdometryModel,
    reach: float,
    noise: RangeNoise,
    polish: Polish,
    limits: Limits,
) -> Followed:
    """Follow scans until one is to become a key scan, or is no plain match.

    Args:
        ranges: (n, n_beams) [m], NaN without return.
        steps: (n, 3) odometry from the scan before to each.
        geometry: the laser.
        local_map: the reference.
        standing: where the robot is before the first of the scans.
        odometry: how far it is believed.
        reach: see `extract_points` [m] …
        noise: …
        polish: how a scan is matched.
        limits: where it ends.

    Returns:
        The scans followed; none if the first one is no plain match.
    """
    poses = np.empty((len(steps) + 1, 3))
    poses[0] = standing.T_ref_robot
    field, motion = local_map.fine, standing.motion
    way = kernels.Way(
        T_ref_key=standing.T_ref_key,
        T_key_robot=motion.T_key_robot.copy(),
        covariance=motion.covariance.copy(),
        path=np.array((motion.distance, motion.turn)),
    )
    n_beams = geometry.n_beams
    returns = kernels.Returns(
        np.empty((n_beams, 2)), np.empty((n_beams, 2)), np.empty(n_beams, np.int32), np.empty(n_beams)
    )
    followed, n_points = kernels.follow(
        ranges,
        steps,
        odometry.variances,
        _laser(geometry, reach, noise),
        kernels.Field(surfels=local_map.surfels, nearest=field.nearest, origin=field.origin, cell=field.cell),
        polish,
        limits,
        way,
        poses,
        returns,
    )
    distance, turn = way.path.tolist()
    return Followed(
        T_ref_robots=poses[1 : followed + 1],
        motion=OdometryMotion(T_key_robot=way.T_key_robot, covariance=way.covariance, distance=distance, turn=turn),
        key_scan=_key_scan(ranges[followed - 1], geometry, returns, n_points) if n_points else None,
    )


def _laser(geometry: ScanGeometry, reach: float, noise: RangeNoise) -> kernels.Laser:
    directions, origin = geometry.directions_robot, geometry.origin_robot
    return kernels.Laser(directions=directions, origin=origin, reach=reach, jump=JUMP, noise=noise)


def _key_scan(
    ranges: NDArray[np.float32], geometry: ScanGeometry, returns: kernels.Returns, n: int
) -> tuple[Scan, ScanPoints]:
    points = ScanPoints(
        points=returns.points[:n], normals=returns.normals[:n], beams=returns.beams[:n], spreads=returns.spreads[:n]
    )
    return Scan(ranges=ranges, geometry=geometry), points
