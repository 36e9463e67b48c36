"""What takes odometry's place in a log without: the robot goes on as it went, as well as this robot does.

Where a match does not see a direction, as in front of a single wall, the front end follows the constant velocity. The
graph must know what that is worth: without it, the direction is free between two key poses, and the refinement of poses
and walls follows whatever little the points seem to say. How well a robot keeps its velocity is learnt from the steps
whose matches see all directions.
"""

import numpy as np
from numpy.typing import NDArray

from graph.measurement import NoMatch
from graph.odometry import OdometryModel
from graph.se2 import between, compose, expmap, logmap
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.heading_odometry import HeadingOdometry, with_headings
from iceg.slam.odometry.noise import robust_deviation
from iceg.slam.track import Track


def constant_velocity(
    track: Track, config: CalibrationConfig, heading: HeadingOdometry | None = None
) -> tuple[NDArray[np.float64], OdometryModel] | None:
    """Motion and noise that stand in for odometry.

    Args:
        track: what the front end found in a log without odometry.
        config: how many steps it takes.
        heading: what is known of its turns; None for nothing.

    Returns:
        (n_scans, 3) the front end's own trajectory, which follows the constant velocity where a match says nothing, but
        for the turns that are known otherwise; and the noise of a velocity kept from one key scan to the next. None
        where too few steps tell it.
    """
    poses = compose(np.array([key.T_track_robot for key in track.keys])[track.key_of_scan], track.T_key_scan)
    errors = _errors(track, poses, config.velocity_scans)
    if len(errors) < config.velocity_min_steps:
        return None
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
        return poses, noise
    return with_headings(track, heading.headings), heading.lasting_noise.within(noise)


def _errors(track: Track, poses: NDArray[np.float64], scans: int) -> NDArray[np.float64]:
    """(m, 3) steps seen in all directions, less those of the velocity over so many scans before."""
    steps = [
        (earlier.index, later.index)
        for earlier, later in zip(track.keys, track.keys[1:], strict=False)
        if earlier.index >= scans and not isinstance(later.match, NoMatch) and later.match.is_fully_observed
    ]
    start, end = np.array(steps, dtype=np.int64).reshape(-1, 2).T
    velocity = logmap(between(poses[start - scans], poses[start])) / scans
    expected = expmap(velocity * (end - start)[:, None])
    return between(expected, between(poses[start], poses[end]))
