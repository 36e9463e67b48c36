"""Writing a log as a bag of ROS 1 or ROS 2: /scan, /odom, /tf_static, and /ground_truth where the truth is known."""

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.bags.errors import BagError
from frontends.bags.planar_messages import PlanarMessages, message_store, scan_maker
from frontends.scan import Log
from graph.errors import reason

Storage = Literal["sqlite3", "mcap"]
_SUFFIXES = {"sqlite3": ".db3", "mcap": ".mcap"}
_LEAST_STEP = 1e-6
"""Between two stamps [s]: readers of bags put scans in the order of their stamps."""
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
    store = message_store(Stores.ROS1_NOETIC)
    with staging(path) as room:
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
    store = message_store(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    name = path.name.removesuffix(_SUFFIXES[storage])
    with staging(path) as room:
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
def staging(path: Path) -> Iterator[Path]:
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


def _write(writer: Any, store: Any, pack: Callable[[Any, str], Any], pieces: Iterator[_Piece]) -> None:  # noqa: ANN401
    connections: dict[str, Any] = {}
    for topic, stamp, message in pieces:
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, _TYPES[topic], typestore=store)
        writer.write(connections[topic], round(stamp * 1e9), bytes(pack(message, _TYPES[topic])))


def _messages(path: Path, log: Log, store: Any, *, is_ros1: bool) -> Iterator[_Piece]:  # noqa: ANN401
    """All messages in the order of their recording."""
    make = PlanarMessages(store.types, is_ros1=is_ros1)
    stamps = increasing(log.stamps - 0.5 * abs(log.sweep or 0.0))
    middle = 0.5 * abs(log.sweep or 0.0)
    scan = scan_maker(path, log, make)
    yield _Piece(
        "/tf_static",
        float(stamps[0]),
        make.transforms(float(stamps[0]), {("base_link", "laser"): log.geometry.T_robot_laser}),
    )
    for index, stamp in enumerate(stamps.tolist()):
        if log.has_odometry:
            yield _Piece("/odom", stamp, make.odometry(stamp + middle, log.odometry[index]))
        if log.truth is not None:
            yield _Piece("/ground_truth", stamp, make.truth(stamp + middle, log.truth[index]))
        yield _Piece("/scan", stamp, scan(stamp, log.ranges[index]))
