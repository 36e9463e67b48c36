"""How far two points of a map are apart, and how well that is known: what the joint covariance of the poses is for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.elementary import cos_sin
from graph.errors import IcegError
from graph.se2 import inverse, transform_points
from iceg.run_result.joint_covariance import JointCovariance
from iceg.run_result.run_summary import LaserSummary

SNAP = 0.1
"""A place no farther than this from where a beam ends [m] is taken to be on that wall."""
_BESIDE = 1.0
"""A beam looks at a place that lies within so many beams' width of it."""


class DistanceError(IcegError):
    """A place that no scan has seen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sighting:
    """A point that a scan saw.

    Attributes:
        scan: which scan of the log.
        p_robot: (2,) where it lies in the frame of the robot at that scan [m].
        is_return: whether a beam ended there, so that the noise of the laser is in it.
    """

    scan: int
    p_robot: NDArray[np.float64]
    is_return: bool

    @classmethod
    def of_beam(cls, log: Log, scan: int, beam: int) -> "Sighting":
        """Where a beam of a scan ended.

        Raises:
            DistanceError: the log has no such beam, or nothing returned.
        """
        if not (0 <= scan < len(log) and 0 <= beam < log.geometry.n_beams):
            raise DistanceError(
                f"found beam {beam} of scan {scan}, expected one of {log.geometry.n_beams} beams and {len(log)} scans"
            )
        reach = float(log.ranges[scan, beam])
        if not np.isfinite(reach):
            raise DistanceError(f"beam {beam} of scan {scan} has no return, expected one that met something")
        p_robot = log.geometry.origin_robot + reach * log.geometry.directions_robot[beam]
        return cls(scan=scan, p_robot=p_robot, is_return=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Distance:
    """A measured distance.

    Attributes:
        length: between the two points as the map has them [m].
        deviation: its standard deviation [m].
    """

    length: float
    deviation: float

    def __str__(self) -> str:
        return f"{self.length:.3f} m ± {self.deviation:.3f} m"


def sighting_at(
    p_map: NDArray[np.float64], log: Log, key_scans: NDArray[np.int64], key_poses: NDArray[np.float64]
) -> Sighting:
    """A place of the map, as the key scan saw it that saw it from closest.

    Args:
        p_map: (2,) the place [m].
        log: the log.
        key_scans: (k,) which are key scans …
        key_poses: (k, 3) … and where they were taken, T_map_robot.

    Raises:
        DistanceError: no key scan looked there.
    """
    geometry = log.geometry
    p_robot = transform_points(inverse(key_poses), p_map[None])
    ranges = log.ranges[key_scans].astype(np.float64)
    ends = geometry.origin_robot + ranges[..., None] * geometry.directions_robot
    off = np.hypot(*np.moveaxis(ends - p_robot[:, None], -1, 0))
    off = np.where(np.isfinite(off), off, np.inf)
    away = np.hypot(*(p_robot - geometry.origin_robot).T)
    beams = off.argmin(axis=1)
    on_wall = off[np.arange(len(off)), beams] <= SNAP
    if on_wall.any():
        key = int(np.where(on_wall, away, np.inf).argmin())
        return Sighting.of_beam(log, int(key_scans[key]), int(beams[key]))
    in_view = (_reach_towards(p_robot, ranges, log) >= away) & (away > 0.0)
    if not in_view.any():
        raise DistanceError(f"no key scan looked at ({p_map[0]:.2f}, {p_map[1]:.2f}), expected a place on the map")
    key = int(np.where(in_view, away, np.inf).argmin())
    return Sighting(scan=int(key_scans[key]), p_robot=p_robot[key], is_return=False)


def measured_distance(
    a: Sighting,
    b: Sighting,
    trajectory: NDArray[np.float64],
    key_scans: NDArray[np.int64],
    joint: JointCovariance,
    log: Log,
    laser: LaserSummary | None,
) -> Distance:
    """How far two points are apart.

    Args:
        a: one of them.
        b: the other.
        trajectory: (n_scans, 3) T_map_robot of every scan.
        key_scans: (k,) which are key scans; another scan lies rigidly behind the one before it.
        joint: covariance of the key poses.
        log: the log.
        laser: its noise, as `summary.json` has it; None for none.

    Raises:
        DistanceError: a scan that the log does not have.
    """
    for scan in (a.scan, b.scan):
        if not 0 <= scan < len(trajectory):
            raise DistanceError(f"found scan {scan}, expected one of the {len(trajectory)} scans of the log")
    points = [transform_points(trajectory[seen.scan], seen.p_robot) for seen in (a, b)]
    apart = points[1] - points[0]
    length = float(np.hypot(*apart))
    if length == 0.0:
        return Distance(length=0.0, deviation=0.0)
    along = apart / length
    keys = [int(np.searchsorted(key_scans, seen.scan, side="right")) - 1 for seen in (a, b)]
    gradients: dict[int, NDArray[np.float64]] = {}
    for key, point, sign in zip(keys, points, (-1.0, 1.0), strict=True):
        gradients[key] = gradients.get(key, np.zeros(3)) + sign * _gradient(joint.poses[key], point, along)
    variance = joint.variance(np.array(list(gradients)), np.array(list(gradients.values())))
    for seen in (a, b):
        variance += _of_laser(seen, trajectory[seen.scan], along, log, laser)
    return Distance(length=length, deviation=float(np.sqrt(max(variance, 0.0))))


def _gradient(pose: NDArray[np.float64], p_map: NDArray[np.float64], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) how fast a point that hangs on a pose moves along a direction of the map, by the pose's own x, y, θ."""
    cos, sin = (float(part) for part in cos_sin(pose[2]))
    x, y = p_map - pose[:2]
    forward, left = cos * along[0] + sin * along[1], cos * along[1] - sin * along[0]
    return np.array([forward, left, x * along[1] - y * along[0]])


def _of_laser(
    seen: Sighting, pose: NDArray[np.float64], along: NDArray[np.float64], log: Log, laser: LaserSummary | None
) -> float:
    """Variance along a direction of the map that the noise of a range brings [m²]."""
    if laser is None or not seen.is_return:
        return 0.0
    beam = seen.p_robot - log.geometry.origin_robot
    reach = float(np.hypot(*beam))
    cos, sin = (float(part) for part in cos_sin(pose[2]))
    share = ((cos * along[0] + sin * along[1]) * beam[0] + (cos * along[1] - sin * along[0]) * beam[1]) / reach
    return float(share**2 * (laser["noise_m"] ** 2 + (laser["noise_per_metre"] * reach) ** 2))


def _reach_towards(p_robot: NDArray[np.float64], ranges: NDArray[np.float64], log: Log) -> NDArray[np.float64]:
    """(k,) how far the beam of each key scan reaches that looks towards a place, (k, 2) in its frame; 0 for none."""
    geometry = log.geometry
    ahead = p_robot - geometry.origin_robot
    cosines = (ahead[:, :1] * geometry.directions_robot[:, 0] + ahead[:, 1:] * geometry.directions_robot[:, 1]) / (
        np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    )
    beams = cosines.argmax(axis=1)
    rows = np.arange(len(ranges))
    width = float(geometry.bearings[1] - geometry.bearings[0])
    looks = cosines[rows, beams] >= float(cos_sin(_BESIDE * width)[0])
    return np.where(looks, np.nan_to_num(ranges[rows, beams], nan=0.0), 0.0)
