"""A bag copied message by message: some left out or replaced, others added, all else byte for byte."""

import heapq
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

from frontends.bags.compression import unpacked_message
from frontends.bags.errors import BagError
from frontends.bags.message import Channel
from frontends.bags.planar_messages import message_store
from frontends.bags.rosbags_files import bag_reader
from frontends.bags.storage import Bag, BagFile, is_foreign, said_of_damage

NAMES = ("corrected.bag", "corrected.db3", "corrected.mcap", "metadata.yaml")
"""The files of which a copy may consist."""
_NAME = "corrected"
_CALLER = "/iceg"
_NO_HASH = "RIHS01_" + "0" * 64
"""For types of which old bags of ROS 2 hold no definition."""

Revise = Callable[[Channel, bytes], bytes | None]
"""What becomes of a message's bytes: the same, others, or None for a message that is left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NewTopic:
    """A topic that the copy has and the bag need not have.

    Attributes:
        type: of its messages, as ROS 2 writes it.
        is_latched: whether who subscribes late gets its last message (ROS 2: transient local).
    """

    type: str
    is_latched: bool = False


class NewMessage(NamedTuple):
    """A message to add.

    Attributes:
        recorded: when [ns].
        topic: one of the new ones.
        message: made of the types of `types_of`.
    """

    recorded: int
    topic: str
    message: Any


class _Piece(NamedTuple):
    recorded: int
    connection: Any
    data: bytes


def types_of(bag: Bag) -> Any:  # noqa: ANN401
    """The messages of the ROS that a bag is of."""
    from rosbags.typesys import Stores, get_types_from_msg

    store = message_store(Stores.ROS1_NOETIC if is_ros1(bag) else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf/msg/tfMessage"))
    return store


def is_ros1(bag: Bag) -> bool:
    """Whether a bag is one of ROS 1."""
    return bag.files[0].container == "ros1"


def copy_bag(
    bag: Bag,
    folder: Path,
    *,
    leave_out: Collection[str],
    revise: Revise,
    topics: Mapping[str, NewTopic],
    added: Iterable[NewMessage],
) -> Path:
    """Write a copy as one file of the same container, for ROS 2 with its metadata.yaml.

    Chunks are packed with lz4 (ROS 1) or zstd (MCAP); messages that were packed one by one are not in the copy.

    Args:
        bag: to copy, its indexes sound.
        folder: where its files go, named out of `NAMES`.
        leave_out: topics that the copy does not have.
        revise: asked of every message of the others.
        topics: those of the messages added, by name.
        added: further messages, in the order of their recording.

    Returns:
        The file.

    Raises:
        BagError: the bag is damaged, of several containers, or MCAP that is no recording of ROS 2.
        OSError: the copy cannot be written.
    """
    containers = sorted({file.container for file in bag.files})
    if len(containers) > 1:
        raise BagError(f"{bag.path}: found files of {' and '.join(containers)}, expected one container")
    foreign = next(filter(is_foreign, bag.files), None)
    if foreign is not None:
        raise BagError(f"{foreign.path}: found MCAP whose profile is not ros2, expected a bag of ROS to copy")
    store, container = types_of(bag), containers[0]
    pack = store.serialize_ros1 if container == "ros1" else store.serialize_cdr
    with _writer(folder, container) as writer:
        copy = _Copy(writer, store, container, leave_out)
        for file in bag.files:
            copy.add(_connections(file))
        new = {topic: copy.new_topic(topic, kind) for topic, kind in topics.items()}
        more = (_Piece(m.recorded, new[m.topic], bytes(pack(m.message, topics[m.topic].type))) for m in added)
        kept = (piece for file in bag.files for piece in _kept(file, copy, revise))
        for piece in heapq.merge(more, kept, key=attrgetter("recorded")):
            writer.write(piece.connection, piece.recorded, piece.data)
    room = folder / _NAME
    if room.is_dir():
        for made in list(room.iterdir()):
            made.replace(folder / made.name)
        room.rmdir()
    return next(folder / name for name in NAMES if (folder / name).exists())


@contextmanager
def _reading(file: BagFile) -> Iterator[Any]:
    """A file opened; what trips over damage in the block is told as such."""
    reader = bag_reader(file.path, file.container)
    try:
        reader.open()
        with closing(reader):
            yield reader
    except BagError:
        raise
    except Exception as error:  # damage trips rosbags anywhere
        raise damaged(file.path, said_of_damage(error)) from error


def _connections(file: BagFile) -> list[Any]:
    with _reading(file) as reader:
        return list(reader.connections)


def _kept(file: BagFile, copy: "_Copy", revise: Revise) -> Iterator[_Piece]:
    """The messages of one file that the copy keeps."""
    is_cdr = file.container != "ros1"
    with _reading(file) as reader:
        wanted = {each.id: (copy.of(each), _channel(each, is_cdr=is_cdr)) for each in reader.connections}
        connections = [each for each in reader.connections if wanted[each.id][0] is not None]
        for connection, recorded, data in reader.messages(connections) if connections else ():
            place, channel = wanted[connection.id]
            revised = revise(channel, bytes(unpacked_message(data) if is_cdr else data))
            if revised is not None:
                yield _Piece(recorded, place, revised)


def _channel(connection: Any, *, is_cdr: bool) -> Channel:  # noqa: ANN401
    return Channel(connection.topic, connection.msgtype, is_cdr)


def damaged(path: Path, found: str) -> BagError:
    """What a file that can be read, but not be copied message by message, is told as."""
    return BagError(
        f"{path}: damaged ({found}), expected a sound bag to copy: repair it first with `rosbag reindex` (ROS 1), "
        "`ros2 bag reindex` or `mcap recover`"
    )


class _Copy:
    """The connections of the copy: each of the bag's once, though files that continue each other repeat theirs."""

    def __init__(self, writer: Any, store: Any, container: str, leave_out: Collection[str]) -> None:  # noqa: ANN401
        self._writer = writer
        self._store = store
        self._is_ros1 = container == "ros1"
        self._leave_out = leave_out
        self._made: dict[tuple[str, ...], Any] = {}

    def add(self, connections: Iterable[Any]) -> None:
        """Those of one file of the bag."""
        for of in connections:
            if of.topic not in self._leave_out and self._key(of) not in self._made:
                self._made[self._key(of)] = self._ros1(of) if self._is_ros1 else self._ros2(of)

    def of(self, connection: Any) -> Any:  # noqa: ANN401
        """The one that stands for one of the bag, None where its topic is left out."""
        return self._made.get(self._key(connection))

    def new_topic(self, topic: str, kind: NewTopic) -> Any:  # noqa: ANN401
        """The connection of an added topic: in ROS 2, whose topics have one each, that of the bag if it has it."""
        for of in self._made.values():
            is_ours = self._is_ros1 and of.ext.callerid == _CALLER
            if (of.topic, of.msgtype) == (topic, kind.type) and (is_ours or not self._is_ros1):
                return of
        if self._is_ros1:
            more: dict[str, Any] = {"callerid": _CALLER, "latching": int(kind.is_latched)}
        else:
            more = {"offered_qos_profiles": [_quality(is_latched=kind.is_latched)]}
        return self._writer.add_connection(topic, kind.type, typestore=self._store, **more)

    def _key(self, of: Any) -> tuple[str, ...]:  # noqa: ANN401
        return (of.topic, of.msgtype, str(of.ext), *((of.digest, of.msgdef.data) if self._is_ros1 else ()))

    def _ros1(self, of: Any) -> Any:  # noqa: ANN401
        return self._writer.add_connection(
            of.topic,
            of.msgtype,
            msgdef=of.msgdef.data,
            md5sum=of.digest,
            callerid=of.ext.callerid,
            latching=of.ext.latching,
        )

    def _ros2(self, of: Any) -> Any:  # noqa: ANN401
        is_known = of.msgtype in self._store.fielddefs
        known = self._store.generate_msgdef(of.msgtype, ros_version=2)[0] if is_known else ""
        return self._writer.add_connection(
            of.topic,
            of.msgtype,
            msgdef=of.msgdef.data or known,
            rihs01=of.digest or (self._store.hash_rihs01(of.msgtype) if is_known else _NO_HASH),
            serialization_format=of.ext.serialization_format,
            offered_qos_profiles=of.ext.offered_qos_profiles,
        )


def _writer(folder: Path, container: str) -> Any:  # noqa: ANN401
    if container == "ros1":
        from rosbags.rosbag1 import Writer

        packed = Writer(folder / f"{_NAME}.bag")
        packed.set_compression(Writer.CompressionFormat.LZ4)
        return packed
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    writer = Writer2(folder / _NAME, version=9, storage_plugin=StoragePlugin[container.upper()])
    if container == "mcap":
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    return writer


def _quality(*, is_latched: bool) -> Any:  # noqa: ANN401
    """What ROS 2 publishers of maps (latched) and of transforms offer."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    forever = QosTime(2147483647, 4294967295)
    return Qos(
        QosHistory.KEEP_LAST,
        1 if is_latched else 100,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if is_latched else QosDurability.VOLATILE,
        forever,
        forever,
        QosLiveliness.AUTOMATIC,
        forever,
        False,
    )
