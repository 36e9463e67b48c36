"""The messages that a map is made from, each decoded to plain numbers.

Sources: the definitions of sensor_msgs, nav_msgs, geometry_msgs, tf2_msgs and std_msgs, the same in ROS 1 and ROS 2.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.bags.errors import MalformedMessageError
from frontends.bags.wire import Wire

_MOST_TRANSFORMS = 10_000
_FARTHEST = 1e9
"""Poses farther away [m] are none."""


class LaserScan(NamedTuple):
    """One sweep.

    Attributes:
        stamp: of its first beam [s].
        frame: of the laser.
        setting: angle_min, angle_max, angle_increment [rad], time_increment, scan_time [s], range_min, range_max [m].
        ranges: (n,) as recorded [m].
    """

    stamp: float
    frame: str
    setting: tuple[float, ...]
    ranges: NDArray[np.float32]


class StampedPose(NamedTuple):
    """The pose of a frame in another.

    Attributes:
        stamp: [s].
        parent: the frame it is given in.
        child: the frame whose pose it is, empty where the message does not say.
        pose: x, y, z [m] and the quaternion x, y, z, w.
    """

    stamp: float
    parent: str
    child: str
    pose: tuple[float, ...]


class TurnRate(NamedTuple):
    """What an IMU says of turns.

    Attributes:
        stamp: [s].
        frame: of the IMU.
        rate: angular velocity about x, y and z, [rad/s] by the definition.
        acceleration: along x, y and z, gravity included [m/s²].
    """

    stamp: float
    frame: str
    rate: tuple[float, ...]
    acceleration: tuple[float, ...]


def laser_scan(wire: Wire) -> LaserScan:
    """sensor_msgs/LaserScan, without its intensities."""
    stamp, frame = wire.header()
    setting = wire.seven_floats()
    return LaserScan(stamp, frame, setting, wire.float_array())


def multi_echo_laser_scan(wire: Wire) -> LaserScan:
    """sensor_msgs/MultiEchoLaserScan: the first echo of each beam, NaN where there is none; without its intensities."""
    stamp, frame = wire.header()
    setting = wire.seven_floats()
    return LaserScan(stamp, frame, setting, wire.first_echoes())


def pose_stamped(wire: Wire) -> StampedPose:
    """geometry_msgs/PoseStamped, and PoseWithCovarianceStamped, which begins alike."""
    stamp, frame = wire.header()
    return StampedPose(stamp, frame, "", _finite(wire.doubles(7)))


def transform_stamped(wire: Wire) -> StampedPose:
    """geometry_msgs/TransformStamped, and nav_msgs/Odometry, which begins alike: two frames and seven numbers."""
    stamp, frame = wire.header()
    return StampedPose(stamp, frame, wire.frame(), _finite(wire.doubles(7)))


def transforms(wire: Wire) -> list[StampedPose]:
    """tf2_msgs/TFMessage, and tf/tfMessage of old."""
    n = wire.count()
    if n > _MOST_TRANSFORMS:
        raise MalformedMessageError(f"found {n} transforms, expected at most {_MOST_TRANSFORMS}")
    return [transform_stamped(wire) for _ in range(n)]


def turn_rate(wire: Wire) -> TurnRate:
    """sensor_msgs/Imu."""
    stamp, frame = wire.header()
    wire.skip_doubles(4 + 9)
    rate = _finite(wire.doubles(3))
    wire.skip_doubles(9)
    return TurnRate(stamp, frame, rate, _finite(wire.doubles(3)))


def text(wire: Wire) -> str:
    """std_msgs/String."""
    return wire.string()


SCANS: dict[str, Callable[[Wire], LaserScan]] = {
    "sensor_msgs/msg/LaserScan": laser_scan,
    "sensor_msgs/msg/MultiEchoLaserScan": multi_echo_laser_scan,
}
"""Messages that hold one sweep."""
IMU = "sensor_msgs/msg/Imu"
STRING = "std_msgs/msg/String"
ODOMETRY = "nav_msgs/msg/Odometry"
POSES: dict[str, Callable[[Wire], StampedPose]] = {
    ODOMETRY: transform_stamped,
    "geometry_msgs/msg/PoseStamped": pose_stamped,
    "geometry_msgs/msg/PoseWithCovarianceStamped": pose_stamped,
    "geometry_msgs/msg/TransformStamped": transform_stamped,
}
"""Messages that hold one pose."""
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


def _finite(numbers: tuple[float, ...]) -> tuple[float, ...]:
    # Comparisons with NaN are false: it passes neither.
    if not (min(numbers) > -_FARTHEST and max(numbers) < _FARTHEST and sum(numbers) < math.inf):
        raise MalformedMessageError("found NaN, infinity or a number beyond all reason, expected finite numbers")
    return numbers
