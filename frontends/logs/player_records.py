"""One pass through a Player log: scans, poses, and what it says about its lasers."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs.beams import BeamDescription, Setup
from frontends.logs.budget import Budget
from frontends.logs.line_loop import LineTroubles, read_lines
from frontends.logs.player_messages import Device, Message, Mount, Pose, Scan, parse_message
from frontends.logs.text import Line
from frontends.pose_samples import poses_at


@dataclass(slots=True, kw_only=True)
class TimedPoses:
    """The poses of one source, row by row as they stand in the file.

    Attributes:
        stamps: [s].
        poses: of the robot.
    """

    stamps: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)

    def __len__(self) -> int:
        """Number of messages."""
        return len(self.poses)

    def add(self, stamp: float, pose: Pose) -> None:
        """One more message."""
        self.stamps.append(stamp)
        self.poses.append(pose)

    def at(self, stamps: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) between the messages, at (n,) stamps [s]."""
        return poses_at(np.array(self.stamps), np.array(self.poses), stamps)


@dataclass(slots=True, kw_only=True)
class Sweeps:
    """The scans of one laser, row by row as they stand in the file.

    Attributes:
        ranges: of each scan [m].
        setups: its beams.
        stamps: [s].
        poses: of the robot, those that came with the scans.
    """

    ranges: list[NDArray[np.float32]] = field(default_factory=list)
    setups: list[Setup] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    poses: TimedPoses = field(default_factory=TimedPoses)


@dataclass(slots=True, kw_only=True)
class Records:
    """What the lines of a log held.

    Attributes:
        sweeps: by laser.
        poses: by source of odometry.
        mounts: by laser, the last that the log says.
        beams: of rangers, as the log says last.
        counts: messages by device.
        troubles: lines passed over, and what else a person should know.
    """

    sweeps: dict[Device, Sweeps] = field(default_factory=dict)
    poses: dict[Device, TimedPoses] = field(default_factory=dict)
    mounts: dict[Device, Mount] = field(default_factory=dict)
    beams: dict[Device, BeamDescription] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    troubles: LineTroubles = field(default_factory=LineTroubles)


def collect(path: Path, *, skip_bad_lines: bool) -> Records:
    """Go through the log once."""
    records, budget = Records(), Budget(path)

    def read(line: Line) -> None:
        message = parse_message(line)
        if message is not None:
            _record(records, message, budget)

    read_lines(path, read, records.troubles, skip_bad_lines=skip_bad_lines)
    return records


def _record(records: Records, message: Message, budget: Budget) -> None:
    device, stamp, said = message
    if isinstance(said, Scan):
        budget.take(len(said.ranges))
        sweeps = records.sweeps.setdefault(device, Sweeps())
        sweeps.ranges.append(said.ranges)
        sweeps.setups.append(Setup(len(said.ranges), said.beams or records.beams.get(device)))
        sweeps.stamps.append(stamp)
        if said.pose is not None:
            sweeps.poses.add(stamp, said.pose)
    elif isinstance(said, Pose):
        records.poses.setdefault(device, TimedPoses()).add(stamp, said)
    elif isinstance(said, Mount):
        records.mounts[device] = said
    elif said is not None:
        records.beams[device] = said
    records.counts[device.name] += 1
