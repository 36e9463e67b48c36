"""A run as a bag of ROS 2 in MCAP, which Foxglove opens and `ros2 bag play` plays, with a layout for Foxglove."""

import dataclasses
import heapq
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.bags.planar_messages import PlanarMessages, message_store, scan_maker
from graph.errors import reason
from graph.publish import publishing
from graph.se2 import compose, inverse
from iceg.export import map_messages
from iceg.export.foxglove_layout import foxglove_layout
from iceg.export.map_messages import MAP, Colour
from iceg.export.options import ExportError, ExportOptions
from iceg.export.recorded_run import RecordedRun, read_recorded_run
from iceg.plain_json import format_json

RECORDING, METADATA, LAYOUT = "run.mcap", "metadata.yaml", "foxglove-layout.json"
_TYPES = {
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/scan": "sensor_msgs/msg/LaserScan",
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/path": "nav_msgs/msg/Path",
    "/path_so_far": "nav_msgs/msg/Path",
    "/pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/deviations": "geometry_msgs/msg/Vector3Stamped",
    "/graph": "visualization_msgs/msg/MarkerArray",
    "/closures": "visualization_msgs/msg/MarkerArray",
    "/landmarks": "visualization_msgs/msg/MarkerArray",
    "/walls": "visualization_msgs/msg/MarkerArray",
}
_MOST_PATHS, _MOST_PATH_POSES = 200, 500
"""A path so far is written whole each time: so often at most, of so many poses at most, whatever the log's length."""
_GREY: Colour = (0.45, 0.45, 0.5, 0.8)
_EDGES: dict[str, Colour] = {
    "odometry": (0.55, 0.55, 0.6, 0.9),
    "ice": (0.35, 0.45, 0.75, 0.9),
    "closure": (0.1, 0.65, 0.3, 0.9),
}
_VERDICTS: dict[str, Colour] = {
    "accepted": (0.1, 0.65, 0.3, 1.0),
    "rejected": (0.85, 0.3, 0.2, 0.35),
    "removed": (0.9, 0.55, 0.1, 1.0),
}
_LANDMARKS: dict[str, Colour] = {
    "corner": (0.85, 0.2, 0.2, 1.0),
    "end_of_wall": (0.9, 0.6, 0.1, 1.0),
    "intersection": (0.55, 0.3, 0.8, 1.0),
}
_WALLS: dict[str, Colour] = {"walls": (0.1, 0.1, 0.15, 1.0)}


class _Piece(NamedTuple):
    stamp: float
    topic: str
    message: Any


def write_mcap(directory: Path, path: Path, options: ExportOptions) -> None:
    """Write a folder of `run.mcap`, `metadata.yaml` and `foxglove-layout.json`.

    Args:
        directory: of the run.
        path: the folder; these three files in it are replaced in one step.
        options: with the log, where the run has not kept its scans.

    Raises:
        IcegError: a file cannot be read or written, or the log is not that of the run.
    """
    from rosbags.typesys import Stores

    run = read_recorded_run(directory, options)
    store = message_store(Stores.ROS2_HUMBLE)
    pieces = _pieces(run, path, PlanarMessages(store.types, is_ros1=False))
    try:
        with publishing(path, replaces=(RECORDING, METADATA, LAYOUT)) as staging:
            _write_bag(staging, store, pieces)
            layout = format_json(foxglove_layout(run.found.grid.extent), indent=2) + "\n"
            (staging / LAYOUT).write_text(layout, encoding="ascii", newline="\n")
    except OSError as err:
        raise ExportError(f"{path}: cannot be written: {reason(err)}") from err


def _write_bag(staging: Path, store: Any, pieces: Iterator[_Piece]) -> None:  # noqa: ANN401
    """Write `run.mcap` and `metadata.yaml` into a folder."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    room = staging / Path(RECORDING).stem
    writer = Writer(room, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = {name: writer.add_connection(name, kind, typestore=store) for name, kind in _TYPES.items()}
        for stamp, topic, message in pieces:
            content = bytes(store.serialize_cdr(message, _TYPES[topic]))
            writer.write(connections[topic], round(stamp * 1e9), content)
    for file in list(room.iterdir()):
        file.replace(staging / file.name)
    room.rmdir()


def _pieces(run: RecordedRun, path: Path, make: PlanarMessages) -> Iterator[_Piece]:
    """All messages by their stamps."""
    streams = [_whole(run, make), _transforms(run, make), _key_poses(run, make), _paths_so_far(run, make)]
    if run.log is not None:
        still = dataclasses.replace(run.log, sweep=None)  # a viewer draws a scan from one pose, that of its stamp
        scan = scan_maker(path, still, make)
        streams.append(
            _Piece(stamp, "/scan", scan(stamp, ranges))
            for stamp, ranges in zip(run.stamps.tolist(), still.ranges, strict=True)
        )
    return heapq.merge(*streams, key=lambda piece: piece.stamp)


def _whole(run: RecordedRun, make: PlanarMessages) -> Iterator[_Piece]:
    """What does not change while the recording plays, at its beginning."""
    start, found = float(run.stamps[0]), run.found
    if run.log is not None:
        mount = {("base_link", "laser"): run.log.geometry.T_robot_laser}
        yield _Piece(start, "/tf_static", make.transforms(start, mount))
    yield _Piece(start, "/map", map_messages.grid_message(make, start, found.grid))
    yield _Piece(start, "/path", map_messages.path_message(make, run.stamps, run.poses))
    edges, cell = run.edges(), found.grid.resolution
    colours = {kind: _EDGES.get(kind, _GREY) for kind in edges}
    yield _Piece(start, "/graph", map_messages.lines_message(make, start, edges, colours, 0.3 * cell))
    yield _Piece(start, "/closures", map_messages.lines_message(make, start, run.closures(), _VERDICTS, 0.6 * cell))
    yield _Piece(start, "/landmarks", map_messages.dots_message(make, start, run.landmarks(), _LANDMARKS, 3.0 * cell))
    walls = {"walls": found.walls.ends}
    yield _Piece(start, "/walls", map_messages.lines_message(make, start, walls, _WALLS, 0.5 * cell))


def _transforms(run: RecordedRun, make: PlanarMessages) -> Iterator[_Piece]:
    """Pose of the robot at each scan; where odometry is known, it lies between (REP 105)."""
    has_odometry = run.log is not None and run.log.has_odometry
    odometry = run.log.odometry if run.log is not None and has_odometry else np.zeros_like(run.poses)
    T_map_odom: NDArray[np.float64] = compose(run.poses, inverse(odometry))
    for index, stamp in enumerate(run.stamps.tolist()):
        chain = (
            {(MAP, "odom"): T_map_odom[index], ("odom", "base_link"): odometry[index]}
            if has_odometry
            else {(MAP, "base_link"): run.poses[index]}
        )
        yield _Piece(stamp, "/tf", make.transforms(stamp, chain))


def _key_poses(run: RecordedRun, make: PlanarMessages) -> Iterator[_Piece]:
    stated = zip(
        run.key_stamps.tolist(), run.found.key_poses, run.found.covariances, run.deviations().tolist(), strict=True
    )
    for stamp, pose, covariance, deviations in stated:
        yield _Piece(stamp, "/pose", map_messages.pose_message(make, stamp, pose, covariance))
        vector = make.types["geometry_msgs/msg/Vector3Stamped"](
            make.header(stamp, "base_link"), make.vector(*deviations)
        )
        yield _Piece(stamp, "/deviations", vector)


def _paths_so_far(run: RecordedRun, make: PlanarMessages) -> Iterator[_Piece]:
    n_keys = len(run.found.key_scans)
    for last in sorted({round(place) for place in np.linspace(0, n_keys - 1, min(n_keys, _MOST_PATHS)).tolist()}):
        places = np.linspace(0, last, min(last + 1, _MOST_PATH_POSES)).round().astype(np.int64)
        message = map_messages.path_message(make, run.key_stamps[places], run.found.key_poses[places])
        yield _Piece(float(run.key_stamps[last]), "/path_so_far", message)
