"""What odometry tells of the way from one key scan to the next."""

from itertools import pairwise

from graph.arrays import Floats
from graph.odometry import OdometryModel, OdometryMotion
from graph.se2 import between
from iceg.slam.track import Track


def motions_of(track: Track, odometry: Floats, noise: OdometryModel) -> list[OdometryMotion | None]:
    """The motion to every key scan but the first.

    Args:
        track: what the front end found.
        odometry: (n_scans, 3) T_odom_robot, calibrated.
        noise: what the calibration left, persistence of errors included.

    Returns:
        None where odometry does not know the way.
    """
    steps = between(odometry[:-1], odometry[1:])
    unknown, standing = track.keys_without_odometry(), noise.start()
    return [
        None if key in unknown else noise.extend(standing, steps[first:last])
        for key, (first, last) in enumerate(pairwise(track.key_scans), start=1)
    ]
