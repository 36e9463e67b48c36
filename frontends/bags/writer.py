"""Writing a log as a bag of ROS 1 or ROS 2: /scan, /odom, /tf_static, and /ground_truth where the truth is known."""

import math
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.bags.errors import BagError
from frontends.scan import Log
from graph.errors import reason

Storage = Literal["sqlite3", "mcap"]
_SUFFIXES = {"sqlite3": ".db3", "mcap": ".mcap"}
_LEAST_STEP = 1e-6
"""Between two stamps [s]: readers of bags put scans in the order of their stamps."""
_TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"
_TYPES = {
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/odom": "nav_msgs/msg/Odometry",
    "/ground_truth": "geometry_msgs/msg/PoseStamped",
    "/scan": "sensor_msgs/msg/LaserScan",
}


class _Piece(NamedTuple):
    topic: str
    stamp: float
    message: Any


def write_ros1_bag(path: Path | str, log: Log) -> None:
    """Write a bag of ROS 1, its chunks packed with lz4.

    Args:
        path: the file, replaced as a whole when all is written.
        log: what to write.

    Raises:
        BagError: the file cannot be written, or the beams are not evenly spread, for which there is no message.
    """
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores

    path = Path(path)
    store = _store(Stores.ROS1_NOETIC)
    with _staging(path) as room:
        writer = Writer(room / "log.bag")
        writer.set_compression(Writer.CompressionFormat.LZ4)
        with writer:
            _write(writer, store, store.serialize_ros1, _messages(path, log, store, is_ros1=True))
        (room / "log.bag").replace(path)


def write_ros2_bag(path: Path | str, log: Log, storage: Storage) -> None:
    """Write a bag of ROS 2.

    Args:
        path: a file where it ends with .db3 or .mcap, else a folder with metadata.yaml, which must not be there yet.
        log: what to write.
        storage: the kind of file.

    Raises:
        BagError: the bag cannot be written, or the beams are not evenly spread, for which there is no message.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores

    path = Path(path)
    store = _store(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    name = path.name.removesuffix(_SUFFIXES[storage])
    with _staging(path) as room:
        with Writer(room / name, version=9, storage_plugin=plugin) as writer:
            _write(writer, store, store.serialize_cdr, _messages(path, log, store, is_ros1=False))
        whole = room / name
        (whole / f"{name}{_SUFFIXES[storage]}" if path.suffix == _SUFFIXES[storage] else whole).replace(path)


def increasing(stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stamps (n,) [s] that a bag can carry: not negative, each behind the one before; as they are where they can be."""
    shifted = stamps - min(0.0, float(stamps.min()))
    steps = _LEAST_STEP * np.arange(len(stamps))
    if len(stamps) < 2 or float(np.diff(shifted).min()) >= _LEAST_STEP:
        return shifted
    return np.asarray(np.maximum.accumulate(shifted - steps) + steps)


@contextmanager
def _staging(path: Path) -> Iterator[Path]:
    """A folder beside the bag, gone in the end."""
    try:
        room = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise BagError(f"{path}: cannot be written ({reason(error)})") from error
    try:
        yield room
    except OSError as error:
        raise BagError(f"{path}: cannot be written ({reason(error)})") from error
    finally:
        shutil.rmtree(room, ignore_errors=True)


def _store(name: Any) -> Any:  # noqa: ANN401  (rosbags makes the types of messages when it runs)
    from rosbags.typesys import get_types_from_msg, get_typestore

    store = get_typestore(name)
    if "tf2_msgs/msg/TFMessage" not in store.types:
        store.register(get_types_from_msg(_TRANSFORMS, "tf2_msgs/msg/TFMessage"))
    return store


def _write(writer: Any, store: Any, pack: Callable[[Any, str], Any], pieces: Iterator[_Piece]) -> None:  # noqa: ANN401
    connections: dict[str, Any] = {}
    for topic, stamp, message in pieces:
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, _TYPES[topic], typestore=store)
        writer.write(connections[topic], round(stamp * 1e9), bytes(pack(message, _TYPES[topic])))


def _messages(path: Path, log: Log, store: Any, *, is_ros1: bool) -> Iterator[_Piece]:  # noqa: ANN401
    """All messages in the order of their recording."""
    make = _Maker(store.types, is_ros1=is_ros1)
    stamps = increasing(log.stamps - 0.5 * abs(log.sweep or 0.0))
    middle = 0.5 * abs(log.sweep or 0.0)
    scan = _scan_maker(path, log, make)
    yield _Piece("/tf_static", float(stamps[0]), make.mount(float(stamps[0]), log.geometry.T_robot_laser))
    for index, stamp in enumerate(stamps.tolist()):
        if log.has_odometry:
            yield _Piece("/odom", stamp, make.odometry(stamp + middle, log.odometry[index]))
        if log.truth is not None:
            yield _Piece("/ground_truth", stamp, make.truth(stamp + middle, log.truth[index]))
        yield _Piece("/scan", stamp, scan(stamp, log.ranges[index]))


class _Maker:
    """Makes messages of planar things."""

    def __init__(self, types: Any, *, is_ros1: bool) -> None:  # noqa: ANN401
        self.types = types
        self._is_ros1 = is_ros1

    def header(self, stamp: float, frame: str) -> Any:  # noqa: ANN401
        nanoseconds = round(stamp * 1e9)
        time = self.types["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
        header = self.types["std_msgs/msg/Header"]
        return header(0, time, frame) if self._is_ros1 else header(time, frame)

    def mount(self, stamp: float, T_robot_laser: NDArray[np.float64]) -> Any:  # noqa: ANN401
        x, y, _ = T_robot_laser.tolist()
        transform = self.types["geometry_msgs/msg/Transform"](
            self.types["geometry_msgs/msg/Vector3"](x, y, 0.0), self._quaternion(T_robot_laser)
        )
        stamped = self.types["geometry_msgs/msg/TransformStamped"](self.header(stamp, "base_link"), "laser", transform)
        return self.types["tf2_msgs/msg/TFMessage"]([stamped])

    def odometry(self, stamp: float, pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
        zero = self.types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        unknown = np.zeros(36)
        return self.types["nav_msgs/msg/Odometry"](
            self.header(stamp, "odom"),
            "base_link",
            self.types["geometry_msgs/msg/PoseWithCovariance"](self._pose(pose), unknown),
            self.types["geometry_msgs/msg/TwistWithCovariance"](
                self.types["geometry_msgs/msg/Twist"](zero, zero), unknown
            ),
        )

    def truth(self, stamp: float, pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
        return self.types["geometry_msgs/msg/PoseStamped"](self.header(stamp, "world"), self._pose(pose))

    def _pose(self, pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
        x, y, _ = pose.tolist()
        point = self.types["geometry_msgs/msg/Point"](x, y, 0.0)
        return self.types["geometry_msgs/msg/Pose"](point, self._quaternion(pose))

    def _quaternion(self, pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
        half = 0.5 * float(pose[2])
        return self.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(half), math.cos(half))


def _scan_maker(path: Path, log: Log, make: _Maker) -> Callable[[float, NDArray[np.float32]], Any]:
    """Makes the LaserScan of a stamp and its ranges; beams are listed in the order in which they are measured."""
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
