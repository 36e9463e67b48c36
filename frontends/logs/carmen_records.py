"""One pass through a CARMEN log: the sweeps of one laser, and what else tells about them."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs.beams import Setup
from frontends.logs.budget import Budget
from frontends.logs.carmen_messages import FORMATS, parse_laser, parse_odometry, parse_parameter
from frontends.logs.errors import MalformedLineError
from frontends.logs.line_loop import LineTroubles, read_lines
from frontends.logs.text import Line

_NAMES = {name.encode(): name for name in (*FORMATS, "ODOM", "PARAM", "SYNC")}


@dataclass(slots=True)
class Records:
    """What the lines of a log held: the sweeps of the best laser message met so far, and everything about them.

    Attributes:
        name: the laser message that is used.
        ranges: of each sweep, as recorded [m].
        poses: of each sweep, laser and robot pose as recorded; empty where the message has none.
        stamps: of each sweep, its own and the logger's [s].
        setups: of each sweep, number and description of its beams.
        odometry: robot poses of the ODOM lines, kept only for messages without poses.
        scans_before_odometry: how many sweeps stood in the file before each of them.
        parameters: the PARAM lines.
        counts: messages by kind.
        troubles: lines passed over, and what else a person should know.
    """

    name: str = ""
    ranges: list[NDArray[np.float32]] = field(default_factory=list)
    poses: list[tuple[float, ...]] = field(default_factory=list)
    stamps: list[tuple[float, float]] = field(default_factory=list)
    setups: list[Setup] = field(default_factory=list)
    odometry: list[tuple[float, ...]] = field(default_factory=list)
    scans_before_odometry: list[int] = field(default_factory=list)
    parameters: dict[str, str] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    troubles: LineTroubles = field(default_factory=LineTroubles)

    def change_to(self, name: str) -> None:
        """Start over with a better laser message."""
        self.name = name
        for rows in (self.ranges, self.poses, self.stamps, self.setups):
            rows.clear()
        self.scans_before_odometry = [0] * len(self.odometry)


def collect(path: Path, names: tuple[str, ...], *, skip_bad_lines: bool) -> Records:
    """Go through the log once."""
    ranks = {name: rank for rank, name in enumerate(names)}
    best = len(names)
    records = Records()
    budget = Budget(path)

    def read(line: Line) -> None:
        nonlocal best
        name = _message_name(line)
        if not name:
            return
        rank = ranks.get(name, len(names))
        if rank < best:
            _record_laser(records, line, name, budget)
            best = rank
        elif rank == best < len(names):
            _record_laser(records, line, name, budget)
        elif name == "ODOM":
            _record_odometry(records, line)
        elif name == "PARAM":
            _record_parameter(records, line)
        records.counts[name] += 1

    read_lines(path, read, records.troubles, skip_bad_lines=skip_bad_lines)
    return records


def _message_name(line: Line) -> str:
    """The first word of a line, empty for a comment or a blank line."""
    space = line.block.find(b" ", line.start, line.stop)
    word = line.block[line.start : space if space >= 0 else line.stop]
    known = _NAMES.get(word)
    if known is not None and space >= 0:
        return known
    if not word.isalnum():
        words = line.text.split(None, 1)
        if not words or words[0].startswith(b"#"):
            return ""
        word = words[0]
    name = word.decode("ascii", "backslashreplace")
    if not (name.isidentifier() and word.isascii()):
        raise MalformedLineError(f"'{name[:40]}'", "a message name such as FLASER, or a comment with #")
    if space < 0 and not line.terminated:
        raise MalformedLineError(f"'{name[:40]}' and no more", "a whole message")
    return name


def _record_laser(records: Records, line: Line, name: str, budget: Budget) -> None:
    message = parse_laser(line, name)
    budget.take(len(message.ranges))
    if name != records.name:
        records.change_to(name)
    records.ranges.append(message.ranges)
    records.poses.append(message.poses)
    records.stamps.append((message.stamp, message.logger_stamp))
    records.setups.append(Setup(len(message.ranges), message.beams))


def _record_odometry(records: Records, line: Line) -> None:
    if records.name and not records.name.startswith("RAWLASER"):
        return
    records.odometry.append(parse_odometry(line))
    records.scans_before_odometry.append(len(records.ranges))


def _record_parameter(records: Records, line: Line) -> None:
    name, value = parse_parameter(line)
    records.parameters[name] = value
