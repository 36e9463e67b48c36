"""Messages of ROS that say where things are in the plane, and what a laser has seen."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.bags.errors import BagError
from frontends.scan import Log

_TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"


def message_store(name: Any) -> Any:  # noqa: ANN401  (rosbags makes the types of messages when it runs)
    """The messages of one of rosbags' `Stores`, with that of transforms, which ROS 1's lacks."""
    from rosbags.typesys import get_types_from_msg, get_typestore

    store = get_typestore(name)
    if "tf2_msgs/msg/TFMessage" not in store.types:
        store.register(get_types_from_msg(_TRANSFORMS, "tf2_msgs/msg/TFMessage"))
    return store


class PlanarMessages:
    """Makes messages of planar things."""

    def __init__(self, types: Any, *, is_ros1: bool) -> None:  # noqa: ANN401
        self.types = types
        self._is_ros1 = is_ros1

    def header(self, stamp: float, frame: str) -> Any:  # noqa: ANN401
        """Header of a stamp [s] and the name of a frame."""
        nanoseconds = round(stamp * 1e9)
        time = self.types["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
        header = self.types["std_msgs/msg/Header"]
        return header(0, time, frame) if self._is_ros1 else header(time, frame)

    def transforms(self, stamp: float, poses: Mapping[tuple[str, str], NDArray[np.float64]]) -> Any:  # noqa: ANN401
        """TFMessage of the poses (3,) of frames, by the names of parent and child."""
        kinds = self.types
        stamped = [
            kinds["geometry_msgs/msg/TransformStamped"](
                self.header(stamp, parent),
                child,
                kinds["geometry_msgs/msg/Transform"](self.vector(*T[:2].tolist()), self._quaternion(T)),
            )
            for (parent, child), T in poses.items()
        ]
        return kinds["tf2_msgs/msg/TFMessage"](stamped)

    def vector(self, x: float, y: float, z: float = 0.0) -> Any:  # noqa: ANN401
        """Vector3 of three numbers."""
        return self.types["geometry_msgs/msg/Vector3"](x, y, z)

    def point(self, x: float, y: float, z: float = 0.0) -> Any:  # noqa: ANN401
        """Point [m]."""
        return self.types["geometry_msgs/msg/Point"](x, y, z)

    def odometry(self, stamp: float, pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
        """Odometry with a pose (3,) of the robot, and no velocity."""
        zero = self.vector(0.0, 0.0)
        unknown = np.zeros(36)
        return self.types["nav_msgs/msg/Odometry"](
            self.header(stamp, "odom"),
            "base_link",
            self.types["geometry_msgs/msg/PoseWithCovariance"](self.pose(pose), unknown),
            self.types["geometry_msgs/msg/TwistWithCovariance"](
                self.types["geometry_msgs/msg/Twist"](zero, zero), unknown
            ),
        )

    def truth(self, stamp: float, pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
        """PoseStamped of a pose (3,) in the frame `world`."""
        return self.stamped_pose(stamp, "world", pose)

    def stamped_pose(self, stamp: float, frame: str, pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
        """PoseStamped of a pose (3,)."""
        return self.types["geometry_msgs/msg/PoseStamped"](self.header(stamp, frame), self.pose(pose))

    def pose(self, pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
        """Pose of x, y [m] and heading [rad]."""
        return self.types["geometry_msgs/msg/Pose"](self.point(*pose[:2].tolist()), self._quaternion(pose))

    def _quaternion(self, pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
        half = 0.5 * float(pose[2])
        return self.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(half), math.cos(half))


def scan_maker(path: Path, log: Log, make: PlanarMessages) -> Callable[[float, NDArray[np.float32]], Any]:
    """What makes the LaserScan of a stamp and its ranges; beams are listed in the order in which they are measured."""
    bearings = log.geometry.bearings
    if not np.allclose(np.diff(bearings, 2), 0.0, atol=1e-6):
        raise BagError(f"{path}: found unevenly spread beams, expected the same step between all of them")
    is_clockwise = (log.sweep or 0.0) < 0.0
    first, last = (bearings[-1], bearings[0]) if is_clockwise else (bearings[0], bearings[-1])
    longest = float(np.fmax.reduce(log.ranges, axis=None, initial=0.0))
    limit = np.nextafter(np.float32(max(longest, log.geometry.range_max)), np.float32(math.inf))
    n_steps = len(bearings) - 1
    no_intensities = np.zeros(0, dtype=np.float32)

    def make_scan(stamp: float, ranges: NDArray[np.float32]) -> Any:  # noqa: ANN401
        readings = np.where(np.isfinite(ranges), ranges, np.float32(math.inf))
        return make.types["sensor_msgs/msg/LaserScan"](
            make.header(stamp, "laser"),
            float(first),
            float(last),
            float(last - first) / n_steps,
            abs(log.sweep or 0.0) / n_steps,
            0.0,
            float(log.geometry.range_min),
            float(limit),
            np.ascontiguousarray(readings[::-1] if is_clockwise else readings),
            no_intensities,
        )

    return make_scan
