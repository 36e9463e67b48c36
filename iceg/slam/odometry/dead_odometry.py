"""What takes the place of odometry that is dead for a while: the velocity, as in a log that has none."""

from collections.abc import Sequence

from graph.arrays import Floats
from graph.measurement import NoMatch
from graph.odometry import OdometryMotion
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.velocity import motions_without_odometry
from iceg.slam.track import Track


def filled_where_dead(
    motions: Sequence[OdometryMotion | None], track: Track, stamps: Floats, config: CalibrationConfig
) -> list[OdometryMotion | None]:
    """The motions of a log; where its odometry is dead, what the velocity tells instead.

    Args:
        motions: to every key scan but the first, by odometry.
        track: what the front end found.
        stamps: (n_scans,) of the scans [s].
        config: when the matches tell enough of the velocity.

    Returns:
        The same; still None where odometry jumped, and where the laser saw nothing either.
    """
    if not track.dead:
        return list(motions)
    by_velocity = motions_without_odometry(track, stamps, config)
    return [
        velocity if motion is None and not isinstance(key.match, NoMatch) else motion
        for motion, velocity, key in zip(motions, by_velocity, track.keys[1:], strict=True)
    ]
