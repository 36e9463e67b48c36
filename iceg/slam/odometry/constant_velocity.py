"""What takes odometry's place in a log without: the robot goes on as it went, as well as this robot does.

Where a match does not see a direction, as in front of a single wall, the front end follows the constant velocity. The
graph must know what that is worth: without it, the direction is free between two key poses, and the refinement of poses
and walls follows whatever little the points seem to say. How well a robot keeps its velocity is learnt from the steps
whose matches see all directions.

Where matches in a row leave a direction open, the velocity along it is not measured either: it walks at random, and the
variance of the way grows with the third power of the time since it was seen (an integrated random walk). A robot is
taken to stand where its log begins.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from graph.measurement import NoMatch
from graph.odometry import OdometryModel, OdometryMotion
from graph.se2 import between, compose, expmap, logmap
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.heading_odometry import HeadingOdometry, with_headings
from iceg.slam.odometry.motions import motions_of
from iceg.slam.odometry.noise import robust_deviation
from iceg.slam.track import KeyScan, Track


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantVelocity:
    """Motion and noise that stand in for odometry.

    Attributes:
        poses: (n_scans, 3) the front end's own trajectory, which follows the constant velocity where a match says
            nothing, but for the turns that are known otherwise.
        noise: of a velocity that was seen, kept from one key scan to the next.
        scans: how many scans such a step takes in the mean.
        has_turns: whether the turns are known otherwise.
    """

    poses: NDArray[np.float64]
    noise: OdometryModel
    scans: float
    has_turns: bool = False

    def motions(self, track: Track) -> list[OdometryMotion | None]:
        """What it tells of the way to every key scan but the first; None where a robot may have been carried."""
        found = motions_of(track, self.poses, self.noise)
        return [
            None if motion is None else self._widened(motion, start, end)
            for motion, (start, end) in zip(found, _unseen(track), strict=True)
        ]

    def _widened(self, motion: OdometryMotion, start: int, end: int) -> OdometryMotion:
        """The motion of a step that starts and ends so many scans after the velocity was seen."""
        factor = max(1.0, (end**3 - start**3) / self.scans**3) ** 0.5
        factors = np.array([factor, factor, 1.0 if self.has_turns else factor])
        return replace(motion, covariance=motion.covariance * np.outer(factors, factors))


def constant_velocity(
    track: Track, config: CalibrationConfig, heading: HeadingOdometry | None = None
) -> ConstantVelocity | None:
    """What stands in for odometry.

    Args:
        track: what the front end found in a log without odometry.
        config: how many steps it takes.
        heading: what is known of its turns; None for nothing.

    Returns:
        None where too few steps tell how well the velocity is kept.
    """
    poses = compose(np.array([key.T_track_robot for key in track.keys])[track.key_of_scan], track.T_key_scan)
    start, end = _seen_steps(track, config.velocity_scans)
    if len(start) < config.velocity_min_steps:
        return None
    errors, scans = _errors(poses, start, end, config.velocity_scans), float(np.mean(end - start))
    along, across, turn = (max(robust_deviation(column), config.velocity_min_sigma) for column in errors.T)
    noise = OdometryModel(
        along_per_metre=0.0,
        across_per_metre=0.0,
        position_per_radian=0.0,
        heading_per_metre=0.0,
        heading_per_radian=0.0,
        along_floor=along,
        across_floor=across,
        heading_floor=turn,
    )
    if heading is None:
        return ConstantVelocity(poses=poses, noise=noise, scans=scans)
    return ConstantVelocity(
        poses=with_headings(track, heading.headings),
        noise=heading.lasting_noise.within(noise),
        scans=scans,
        has_turns=True,
    )


def _unseen(track: Track) -> list[tuple[int, int]]:
    """To every key scan but the first: scans since a match saw all of the velocity, where the step starts and ends."""
    spans, seen = [], track.keys[0].index
    for earlier, later in pairwise(track.keys):
        spans.append((earlier.index - seen, later.index - seen))
        if _is_seen(later):
            seen = later.index
    return spans


def _is_seen(key: KeyScan) -> bool:
    return not isinstance(key.match, NoMatch) and key.match.is_fully_observed


def _seen_steps(track: Track, scans: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last scans, (m,) each, of the steps seen in all directions that so many scans precede."""
    steps = [
        (earlier.index, later.index)
        for earlier, later in pairwise(track.keys)
        if earlier.index >= scans and _is_seen(later)
    ]
    start, end = np.array(steps, dtype=np.int64).reshape(-1, 2).T
    return start, end


def _errors(
    poses: NDArray[np.float64], start: NDArray[np.int64], end: NDArray[np.int64], scans: int
) -> NDArray[np.float64]:
    """(m, 3) steps between scans of a trajectory, less those of the velocity over so many scans before."""
    velocity = logmap(between(poses[start - scans], poses[start])) / scans
    expected = expmap(velocity * (end - start)[:, None])
    return between(expected, between(poses[start], poses[end]))
