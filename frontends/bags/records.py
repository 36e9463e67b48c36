"""What a bag holds of laser, odometry, transforms and IMU, gathered in one pass."""

from array import array
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.bags import messages
from frontends.bags.compression import unpacked_message
from frontends.bags.errors import MalformedMessageError
from frontends.bags.message import Channel, Message
from frontends.bags.messages import StampedPose
from frontends.bags.point_clouds import POINT_CLOUD, point_cloud
from frontends.bags.storage import Bag, DamagedFileError
from frontends.bags.wire import Wire

_TYPES = frozenset({messages.IMU, messages.STRING, *messages.SCANS, *messages.POSES, *messages.TRANSFORMS})
_SCANS = {**messages.SCANS, POINT_CLOUD: point_cloud}
_PROGRESS = 512
"""Messages between two reports of progress."""


class Laser(NamedTuple):
    """One laser: lasers may share a topic, and are told apart by their frames."""

    topic: str
    frame: str


class PoseSource(NamedTuple):
    """Poses of one topic."""

    topic: str
    type: str
    parent: str
    child: str


@dataclass(slots=True)
class ScanRecords:
    """The sweeps of one laser in the order of the bag.

    Attributes:
        ranges: readings of each [m], as recorded.
        settings: what each says of its beams (`LaserScan.setting`).
        stamps: of each message [s].
        recorded: when each was recorded [s].
    """

    ranges: list[NDArray[np.float32]] = field(default_factory=list)
    settings: list[tuple[float, ...]] = field(default_factory=list)
    stamps: "array[float]" = field(default_factory=lambda: array("d"))
    recorded: "array[float]" = field(default_factory=lambda: array("d"))

    def __len__(self) -> int:
        """Number of sweeps."""
        return len(self.ranges)


class Rows:
    """Rows of numbers that begin with a stamp and the time of recording [s]."""

    __slots__ = ("_numbers", "_width")

    def __init__(self, width: int) -> None:
        self._numbers = array("d")
        self._width = width + 2

    def __len__(self) -> int:
        """Number of rows."""
        return len(self._numbers) // self._width

    def add(self, stamp: float, recorded: float, numbers: tuple[float, ...]) -> None:
        """One more."""
        self._numbers.extend((stamp, recorded, *numbers))

    @property
    def stamps(self) -> NDArray[np.float64]:
        """(n,) [s]."""
        return self._table()[:, 0]

    @property
    def recorded(self) -> NDArray[np.float64]:
        """(n,) [s]."""
        return self._table()[:, 1]

    @property
    def values(self) -> NDArray[np.float64]:
        """(n, width)."""
        return self._table()[:, 2:]

    def _table(self) -> NDArray[np.float64]:
        return np.array(self._numbers, dtype=np.float64).reshape(-1, self._width)


@dataclass(slots=True, kw_only=True)
class Records:
    """What the messages of a bag held.

    Attributes:
        scans: sweeps by laser.
        poses: x, y, z and quaternion by topic.
        transforms: the same by parent and child frame.
        fixed: which of the transforms are stated once and for all.
        imus: turn rates and accelerations by topic and frame.
        descriptions: texts that may describe the robot.
        counts: messages by topic and type, used or not.
        malformed: messages passed over, by topic.
        first_malformed: what was wrong with the first of each topic.
    """

    scans: dict[Laser, ScanRecords] = field(default_factory=dict)
    poses: dict[PoseSource, Rows] = field(default_factory=dict)
    transforms: dict[tuple[str, str], Rows] = field(default_factory=dict)
    fixed: set[tuple[str, str]] = field(default_factory=set)
    imus: dict[Laser, Rows] = field(default_factory=dict)
    descriptions: list[str] = field(default_factory=list)
    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    malformed: Counter[str] = field(default_factory=Counter)
    first_malformed: dict[str, str] = field(default_factory=dict)
    told: list[str] = field(default_factory=list)

    def add(self, message: Message) -> None:
        """Take in what one message says; one that is none of its type is counted and passed over."""
        channel = message.channel
        try:
            data = unpacked_message(message.data) if channel.is_cdr else message.data
            _TAKERS[channel.type](self, channel, message.recorded, Wire(data, is_cdr=channel.is_cdr))
        except MalformedMessageError as error:
            self.malformed[channel.topic] += 1
            self.first_malformed.setdefault(channel.topic, str(error))

    def see(self, channel: Channel, n: int) -> None:
        """Count messages of a channel."""
        self.counts[channel.topic, channel.type] += n

    def warnings(self) -> list[str]:
        """What a person should know about damage."""
        malformed = [
            f"{topic}: {n} malformed messages are left out ({self.first_malformed[topic]})"
            for topic, n in self.malformed.items()
        ]
        return [*self.told, *malformed]


def collect(bag: Bag, progress: Callable[[int, int], None] | None = None, scan_topic: str | None = None) -> Records:
    """Go through a bag once; once more from the beginning where the index of a file turns out to be broken.

    Point clouds are looked at where there is no scan: a laser that has both says the same with its scans, sooner.

    Args:
        bag: its files.
        progress: called with how many messages are read, and how many are known of.
        scan_topic: topic of the laser that is asked for; None for any.

    Raises:
        BagError: a file cannot be read.
    """
    types = _TYPES
    while True:
        records = Records()
        try:
            for n, message in enumerate(bag.messages(types, records.see, records.told.append)):
                records.add(message)
                if progress is not None and n % _PROGRESS == 0:
                    progress(n, sum(count for (_, kind), count in records.counts.items() if kind in types))
        except DamagedFileError as damage:
            bag.damaged[damage.file] = damage.found
            continue
        has_scans = any(is_called(laser.topic, scan_topic) for laser in records.scans)
        has_clouds = any(kind == POINT_CLOUD and is_called(topic, scan_topic) for topic, kind in records.counts)
        if has_scans or not has_clouds or POINT_CLOUD in types:
            return records
        types |= {POINT_CLOUD}


def is_called(topic: str, wanted: str | None) -> bool:
    """Whether a topic is the one that is asked for, any if none is, with its first slash or without."""
    return wanted is None or topic.strip("/") == wanted.strip("/")


def _take_scan(records: Records, channel: Channel, recorded: float, wire: Wire) -> None:
    stamp, frame, setting, ranges = _SCANS[channel.type](wire)
    scans = records.scans.get((channel.topic, frame))  # type: ignore[call-overload]  # equal to a Laser, and quicker
    if scans is None:
        scans = records.scans[Laser(channel.topic, frame)] = ScanRecords()
    scans.ranges.append(ranges)
    scans.settings.append(setting)
    scans.stamps.append(stamp)
    scans.recorded.append(recorded)


def _take_pose(records: Records, channel: Channel, recorded: float, wire: Wire) -> None:
    stamp, parent, child, pose = messages.POSES[channel.type](wire)
    source = (channel.topic, channel.type, parent, child)
    rows = records.poses.get(source)  # type: ignore[call-overload]
    if rows is None:
        rows = records.poses[PoseSource(*source)] = Rows(7)
    rows.add(stamp, recorded, pose)


def _take_transforms(records: Records, channel: Channel, recorded: float, wire: Wire) -> None:
    for transform in messages.transforms(wire):
        add_transform(records, transform, recorded, fixed=channel.topic.endswith("tf_static"))


def add_transform(records: Records, transform: StampedPose, recorded: float, *, fixed: bool) -> None:
    """One more transform; of the fixed ones the first counts."""
    edge = (transform.parent, transform.child)
    rows = records.transforms.get(edge)
    if rows is None:
        rows = records.transforms[edge] = Rows(7)
        if fixed:
            records.fixed.add(edge)
    if not (fixed and len(rows)):
        rows.add(transform.stamp, recorded, transform.pose)


def _take_turn_rate(records: Records, channel: Channel, recorded: float, wire: Wire) -> None:
    stamp, frame, rate, acceleration = messages.turn_rate(wire)
    rows = records.imus.get((channel.topic, frame))  # type: ignore[call-overload]
    if rows is None:
        rows = records.imus[Laser(channel.topic, frame)] = Rows(6)
    rows.add(stamp, recorded, rate + acceleration)


def _take_text(records: Records, channel: Channel, recorded: float, wire: Wire) -> None:  # noqa: ARG001
    if channel.topic.endswith("robot_description"):
        records.descriptions.append(messages.text(wire))


_TAKERS: dict[str, Callable[[Records, Channel, float, Wire], None]] = {
    messages.IMU: _take_turn_rate,
    messages.STRING: _take_text,
    **dict.fromkeys(_SCANS, _take_scan),
    **dict.fromkeys(messages.POSES, _take_pose),
    **dict.fromkeys(messages.TRANSFORMS, _take_transforms),
}
