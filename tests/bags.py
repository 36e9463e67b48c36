"""Bags for the tests, written with the rosbags library in every container."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from frontends.bags.compression import zstd

SCAN, ODOMETRY, TF, POSE = (
    "sensor_msgs/msg/LaserScan",
    "nav_msgs/msg/Odometry",
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/msg/PoseStamped",
)
MULTI_ECHO = "sensor_msgs/msg/MultiEchoLaserScan"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
IMU = "sensor_msgs/msg/Imu"
STRING, OLD_TF, UNKNOWN = "std_msgs/msg/String", "tf/msg/tfMessage", "some_robot/msg/Bump"
CONTAINERS = (
    "ros1",
    "ros1-bz2",
    "ros1-lz4",
    "sqlite3",
    "sqlite3-file",
    "sqlite3-messages",
    "sqlite3-packed",
    "mcap",
    "mcap-file",
    "mcap-zstd",
    "mcap-messages",
)


class Said(NamedTuple):
    """A message: when it was recorded [s], its topic, its type and what it says."""

    recorded: float
    topic: str
    type: str
    fields: dict[str, Any]


def store(*, is_ros1: bool) -> Any:
    """The message types of a ROS."""
    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name, text in (
        (TF, "geometry_msgs/TransformStamped[] transforms"),
        (OLD_TF, "geometry_msgs/TransformStamped[] transforms"),
        (UNKNOWN, "bool is_pressed"),
    ):
        if name not in types.types:
            types.register(get_types_from_msg(text, name))
    return types


def scan(
    stamp: float,
    ranges: Sequence[float] | NDArray[np.float32],
    *,
    topic: str = "/scan",
    frame: str = "laser",
    first: float = -math.pi / 2,
    step: float | None = None,
    recorded: float | None = None,
    limits: tuple[float, float] = (0.1, 10.0),
    time_increment: float = 0.0,
) -> Said:
    """A LaserScan, over 180° unless said otherwise."""
    readings = np.array(ranges, dtype=np.float32)
    step = math.pi / max(1, len(readings) - 1) if step is None else step
    fields = {
        "header": (stamp, frame),
        "angle_min": first,
        "angle_max": first + step * (len(readings) - 1),
        "angle_increment": step,
        "time_increment": time_increment,
        "range_min": limits[0],
        "range_max": limits[1],
        "ranges": readings,
    }
    return Said(stamp if recorded is None else recorded, topic, SCAN, fields)


def multi_echo(said: Said, echoes: Sequence[Sequence[float]]) -> Said:
    """A MultiEchoLaserScan with the header and the angles of a LaserScan."""
    return said._replace(type=MULTI_ECHO, fields=said.fields | {"ranges": echoes})


def point_cloud(
    stamp: float,
    points: ArrayLike,
    *,
    topic: str = "/points",
    frame: str = "lidar",
    kind: int = 7,
    rows: int = 1,
    is_big_endian: bool = False,
) -> Said:
    """A PointCloud2 of (n, 3) points, float32 or (kind 8) float64, between them an intensity."""
    places = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    number = f"{'>' if is_big_endian else '<'}f{4 if kind == 7 else 8}"
    packed = np.zeros(len(places), np.dtype([("i", "u1"), ("x", number), ("y", number), ("z", number), ("t", "u2")]))
    for axis, name in enumerate("xyz"):
        packed[name] = places[:, axis]
    offsets = {name: packed.dtype.fields[name][1] for name in "xyz"}  # type: ignore[index]
    step, columns = packed.dtype.itemsize, len(places) // rows
    padded = np.zeros((rows, columns * step + 5), np.uint8)
    padded[:, : columns * step] = packed.view(np.uint8).reshape(rows, -1)
    fields = {
        "header": (stamp, frame),
        "fields": [("intensity", 0, 2), *((name, offset, kind) for name, offset in offsets.items())],
        "height": rows,
        "width": columns,
        "is_bigendian": is_big_endian,
        "point_step": step,
        "row_step": padded.shape[1],
        "data": padded.reshape(-1),
    }
    return Said(stamp, topic, POINT_CLOUD, fields)


def odometry(
    stamp: float,
    pose: Sequence[float] | NDArray[np.float64],
    *,
    topic: str = "/odom",
    parent: str = "odom",
    child: str = "base_link",
    recorded: float | None = None,
) -> Said:
    """An Odometry message of a planar pose."""
    fields = {"header": (stamp, parent), "child_frame_id": child, "pose": pose}
    return Said(stamp if recorded is None else recorded, topic, ODOMETRY, fields)


def true_pose(stamp: float, pose: Sequence[float] | NDArray[np.float64], *, topic: str = "/mocap/pose") -> Said:
    """A PoseStamped of a planar pose."""
    return Said(stamp, topic, POSE, {"header": (stamp, "world"), "pose": pose})


def pose_with_covariance(stamp: float, pose: Sequence[float], *, topic: str, parent: str = "odom") -> Said:
    """A PoseWithCovarianceStamped of a planar pose."""
    return Said(stamp, topic, POSE_WITH_COVARIANCE, {"header": (stamp, parent), "pose": pose})


def imu(stamp: float, rates: Sequence[float], *, topic: str = "/imu", recorded: float | None = None) -> Said:
    """An Imu message of turn rates about three axes."""
    return Said(stamp if recorded is None else recorded, topic, IMU, {"header": (stamp, "imu"), "rates": rates})


def transform(
    stamp: float,
    parent: str,
    child: str,
    pose: Sequence[float] | NDArray[np.float64],
    *,
    roll: float = 0.0,
    topic: str = "/tf",
    type_name: str = TF,
) -> Said:
    """One transform of a planar pose, rolled about the child's own x axis."""
    fields = {"header": (stamp, parent), "child_frame_id": child, "pose": pose, "roll": roll}
    return Said(stamp, topic, type_name, fields)


def text(stamp: float, topic: str, words: str) -> Said:
    """A String."""
    return Said(stamp, topic, STRING, {"data": words})


def unknown(stamp: float) -> Said:
    """A message of a type that nobody knows."""
    return Said(stamp, "/bump", UNKNOWN, {"is_pressed": True})


def write_bag(folder: Path, said: Iterable[Said], container: str = "ros1", name: str = "log") -> Path:
    """Write messages in the order of their recording; the path to read."""
    kind, _, variant = container.partition("-")
    is_ros1 = kind == "ros1"
    types = store(is_ros1=is_ros1)
    messages = sorted(said, key=lambda message: message.recorded)
    writer: Any
    if is_ros1:
        path = folder / f"{name}.bag"
        writer = Writer1(path)
        writer.chunk_threshold = 1 << 14
        if variant:
            writer.set_compression(Writer1.CompressionFormat[variant.upper()])
    else:
        path = folder / name
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[kind.upper()])
        modes = {
            "messages": CompressionMode.MESSAGE,
            "zstd": CompressionMode.STORAGE,
            "packed": CompressionMode.FILE,
        }
        if variant in modes:
            writer.set_compression(modes[variant], CompressionFormat.ZSTD)
    pack = types.serialize_ros1 if is_ros1 else types.serialize_cdr
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for message in messages:
            key = (message.topic, message.type)
            if key not in connections:
                connections[key] = writer.add_connection(*key, typestore=types)
            data = pack(make(types, message, is_ros1=is_ros1), message.type)
            writer.write(connections[key], round(1e9 * message.recorded), bytes(data))
    return storage_file(path) if variant == "file" else path


def storage_file(folder: Path) -> Path:
    """The file in the folder of a bag of ROS 2."""
    (file,) = (entry for entry in folder.iterdir() if entry.name != "metadata.yaml")
    return file


def make(types: Any, message: Said, *, is_ros1: bool) -> Any:
    """A message as rosbags wants it."""
    known = types.types
    fields = dict(message.fields)
    if "header" in fields:
        stamp, frame = fields.pop("header")
        nanoseconds = round(1e9 * stamp)
        time = known["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
        header = known["std_msgs/msg/Header"](*((7, time, frame) if is_ros1 else (time, frame)))
    if message.type == SCAN:
        return known[SCAN](header=header, scan_time=0.0, intensities=np.zeros(3, np.float32), **fields)
    if message.type == POINT_CLOUD:
        field = known["sensor_msgs/msg/PointField"]
        fields["fields"] = [field(name, offset, kind, 1) for name, offset, kind in fields["fields"]]
        return known[POINT_CLOUD](header=header, is_dense=False, **fields)
    if message.type == MULTI_ECHO:
        echo = known["sensor_msgs/msg/LaserEcho"]
        beams = [echo(np.array(echoes, np.float32)) for echoes in fields.pop("ranges")]
        return known[MULTI_ECHO](header=header, scan_time=0.0, ranges=beams, intensities=beams[:1], **fields)
    if message.type in {STRING, UNKNOWN}:
        return known[message.type](**fields)
    vector, turned = known["geometry_msgs/msg/Vector3"], known["geometry_msgs/msg/Quaternion"]
    if message.type == IMU:
        rates, gravity, unknown_noise = vector(*fields["rates"]), vector(0.0, 0.0, 9.81), np.zeros(9)
        still = turned(0.0, 0.0, 0.0, 1.0)
        return known[IMU](header, still, unknown_noise, rates, unknown_noise, gravity, unknown_noise)
    x, y, heading = fields["pose"]
    quaternion = turned(*_quaternion(heading, fields.get("roll", 0.0)))
    if message.type in {TF, OLD_TF}:
        pose = known["geometry_msgs/msg/Transform"](vector(x, y, 0.3), quaternion)
        stamped = known["geometry_msgs/msg/TransformStamped"](header, fields["child_frame_id"], pose)
        return known[message.type]([stamped])
    pose = known["geometry_msgs/msg/Pose"](known["geometry_msgs/msg/Point"](x, y, 0.0), quaternion)
    if message.type == POSE:
        return known[POSE](header, pose)
    covariant = known["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
    if message.type == POSE_WITH_COVARIANCE:
        return known[POSE_WITH_COVARIANCE](header, covariant)
    zero = known["geometry_msgs/msg/Twist"](vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    return known[ODOMETRY](
        header,
        fields["child_frame_id"],
        covariant,
        known["geometry_msgs/msg/TwistWithCovariance"](zero, np.zeros(36)),
    )


def _quaternion(heading: float, roll: float) -> tuple[float, float, float, float]:
    """Turned by the heading, then rolled about the own x axis."""
    (sy, cy), (sr, cr) = ((math.sin(0.5 * angle), math.cos(0.5 * angle)) for angle in (heading, roll))
    return cy * sr, sy * sr, sy * cr, cy * cr


def unpacked(data: bytes) -> bytes:
    """A message of ROS 2 that may be packed on its own."""
    return zstd.decompress(data) if data.startswith(b"\x28\xb5\x2f\xfd") else data
