"""How the robot went from one key scan to the next: odometry tells, or the velocity where that is dead or missing."""

from graph.arrays import Floats
from graph.measurement import NoMatch
from graph.odometry import OdometryModel, OdometryMotion
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.heading_odometry import HeadingOdometry
from iceg.slam.odometry.motions import motions_of
from iceg.slam.odometry.velocity import motions_without_odometry
from iceg.slam.track import Track


def key_motions(
    track: Track,
    stamps: Floats,
    odometry: Floats | None,
    noise: OdometryModel,
    config: CalibrationConfig,
    heading: HeadingOdometry | None = None,
) -> list[OdometryMotion | None]:
    """The motion to every key scan but the first.

    Args:
        track: what the front end found.
        stamps: (n_scans,) of the scans [s].
        odometry: (n_scans, 3) T_odom_robot, calibrated; None in a log without.
        noise: what the calibration left of its errors, persistence included.
        config: when the matches tell enough of the velocity.
        heading: what is known of the turns in a log without odometry; None for nothing.

    Returns:
        None where nothing tells the way: where odometry jumped, or is dead and the laser saw nothing either.
    """
    if odometry is None:
        return motions_without_odometry(track, stamps, config, heading)
    by_odometry = motions_of(track, odometry, noise)
    if not track.dead:
        return by_odometry
    by_velocity = motions_without_odometry(track, stamps, config)
    return [
        velocity if motion is None and not isinstance(key.match, NoMatch) else motion
        for motion, velocity, key in zip(by_odometry, by_velocity, track.keys[1:], strict=True)
    ]
