"""The recorded bag with the map, the path and the map's transform of a run in the place of another program's."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from frontends.bags import copying, messages
from frontends.bags.assembly import BagOptions
from frontends.bags.copying import NewMessage, NewTopic
from frontends.bags.errors import MalformedMessageError
from frontends.bags.message import Channel
from frontends.bags.planar_messages import PlanarMessages
from frontends.bags.records import collect
from frontends.bags.storage import Bag, open_bag
from frontends.bags.wire import Wire
from graph.errors import reason
from graph.publish import publishing
from iceg.config import LogConfig, read_config
from iceg.export import map_messages
from iceg.export.map_transform import MapTransform, map_transform
from iceg.export.options import ExportError, ExportOptions
from iceg.export.recorded_log import read_log_of_run
from iceg.run_folder import RunFolder, read_run_folder

_MAP, _PATH, _TF = "/map", "/path", "/tf"
_REPLACED = (_MAP, "/map_metadata", "/map_updates", _PATH)
_BEYOND = 0.5
"""So much before the first scan and behind the last [s] the map's transform is stated, too: a scan bears the stamp of
its first beam, its pose that of the middle."""


def write_corrected_bag(directory: Path, path: Path, options: ExportOptions) -> None:
    """Write a folder with a copy of the bag, `corrected.bag`, `.db3` or `.mcap`, for ROS 2 with `metadata.yaml`.

    Args:
        directory: of the run.
        path: the folder; these files in it are replaced in one step.
        options: with the bag as `log`, and whom to tell what was replaced.

    Raises:
        IcegError: there is no bag, it is damaged, or not the one that was run.
    """
    from frontends.logs.readers import recognise

    if options.log is None:
        raise ExportError("a corrected bag holds all that was recorded: give the recorded bag with --log")
    form = recognise(options.log)
    if form != "bag":
        raise ExportError(
            f"{options.log}: found a log of the format {form}, expected a bag; --to carmen corrects others"
        )
    if options.log.resolve() in (path.resolve() / name for name in copying.NAMES):
        raise ExportError(f"{path}: holds the recorded log itself, expected another place for its copy")
    found, log = read_run_folder(directory), read_log_of_run(directory, options.log)
    bag_options = _bag_options(read_config(directory / "config.toml").log)
    with open_bag(options.log) as bag:
        records = collect(bag, scan_topic=bag_options.scan_topic)
        for file, why in bag.damaged.items():
            raise copying.damaged(file.path, why)
        tie = map_transform(found.trajectory.poses, log, records, bag_options)
        topics = set(records.counts)
        try:
            with publishing(path, replaces=copying.NAMES) as staging:
                replaced = _write(staging, bag, topics, found, tie)
        except OSError as err:
            raise ExportError(f"{path}: cannot be written: {reason(err)}") from err
    counts = {topic: n for (topic, _), n in records.counts.items() if topic in _REPLACED and n}
    for sentence in (*tie.notes, *_told(tie, replaced, counts)):
        options.tell(sentence)


def _bag_options(settings: LogConfig) -> BagOptions:
    """As `read_bag` understands the settings of a run."""
    laser = None if settings.laser == "front" else settings.laser
    return BagOptions(
        scan_topic=settings.scan_topic or laser,
        scan_frame=settings.scan_frame,
        odometry_topic=settings.odometry_topic,
        base_frame=settings.base_frame,
        range_min=settings.range_min,
        range_max=settings.range_max,
    )


def _write(
    staging: Path, bag: Bag, topics: set[tuple[str, str]], found: RunFolder, tie: MapTransform
) -> Counter[tuple[str, str]]:
    """Write the copy; how many transforms were left out, by parent and child."""
    store = copying.types_of(bag)
    make = PlanarMessages(store.types, is_ros1=copying.is_ros1(bag))
    transforms = _OtherTransforms(tie, store)
    tf_type = next((kind for topic, kind in sorted(topics) if topic == _TF), messages.TRANSFORMS[0])
    new = {
        _TF: NewTopic(type=tf_type),
        _MAP: NewTopic(type="nav_msgs/msg/OccupancyGrid", is_latched=True),
        _PATH: NewTopic(type="nav_msgs/msg/Path", is_latched=True),
    }
    copying.copy_bag(
        bag, staging, leave_out=_REPLACED, revise=transforms, topics=new, added=_added(make, tf_type, found, tie)
    )
    return transforms.left_out


def _added(make: PlanarMessages, tf_type: str, found: RunFolder, tie: MapTransform) -> Iterator[NewMessage]:
    """Map and path at the beginning, the map's transform at every scan."""
    start = float(tie.stamps[0]) - _BEYOND
    frame = tie.map_frame
    stamps = np.concatenate([[start], tie.stamps, [float(tie.stamps[-1]) + _BEYOND]])
    recorded = np.maximum.accumulate(np.maximum(stamps + tie.behind, 0.0))
    poses = np.concatenate([tie.T_map_root[:1], tie.T_map_root, tie.T_map_root[-1:]])
    begin = _nanoseconds(recorded[0])
    grid = map_messages.grid_message(make, max(start, 0.0), found.grid, frame)
    yield NewMessage(begin, _MAP, grid)
    path = map_messages.path_message(make, tie.stamps, found.trajectory.poses, frame)
    yield NewMessage(begin, _PATH, path)
    for stamp, at, pose in zip(stamps.tolist(), recorded.tolist(), poses, strict=True):
        message = make.transforms(max(stamp, 0.0), {(frame, tie.root): pose})
        yield NewMessage(_nanoseconds(at), _TF, make.types[tf_type](message.transforms))


def _nanoseconds(seconds: float) -> int:
    return round(float(seconds) * 1e9)


class _OtherTransforms:
    """Keeps the transforms of a bag that the map's does not replace; a message without any other is its old bytes."""

    def __init__(self, tie: MapTransform, store: Any) -> None:  # noqa: ANN401
        self._tie = tie
        self._store = store
        self.left_out: Counter[tuple[str, str]] = Counter()

    def __call__(self, channel: Channel, data: bytes) -> bytes | None:
        if channel.type not in messages.TRANSFORMS:
            return data
        try:
            found = messages.transforms(Wire(data, is_cdr=channel.is_cdr))
        except MalformedMessageError:
            return data
        edges = [(transform.parent, transform.child) for transform in found]
        gone = [parent == self._tie.map_frame or child == self._tie.root for parent, child in edges]
        if not any(gone):
            return data
        self.left_out.update(edge for edge, is_gone in zip(edges, gone, strict=True) if is_gone)
        return None if all(gone) else self._without(channel, data, gone)

    def _without(self, channel: Channel, data: bytes, gone: list[bool]) -> bytes:
        unpack = self._store.deserialize_cdr if channel.is_cdr else self._store.deserialize_ros1
        pack = self._store.serialize_cdr if channel.is_cdr else self._store.serialize_ros1
        message = unpack(data, channel.type)
        message.transforms = [one for one, is_gone in zip(message.transforms, gone, strict=True) if not is_gone]
        return bytes(pack(message, channel.type))


def _told(tie: MapTransform, left_out: Counter[tuple[str, str]], counts: dict[str, int]) -> list[str]:
    """What the copy has instead of what."""
    edges = ", ".join(f"{n} transforms {parent} → {child}" for (parent, child), n in sorted(left_out.items()))
    topics = ", ".join(f"{n} messages on {topic}" for topic, n in sorted(counts.items()))
    replaced = ", ".join(filter(None, [edges, topics])) or "nothing"
    added = f"{tie.map_frame} → {tie.root} at {len(tie.stamps)} scans on {_TF}, {_MAP}, {_PATH}"
    return [f"added: {added}; replaced: {replaced}; all other messages are as recorded"]
