"""One pass through a CARMEN log: the sweeps of one laser, and what else tells about them."""

from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs._sweep_kernels import Plain, Rows, scan_sweeps
from frontends.logs.beams import Setup
from frontends.logs.budget import Budget
from frontends.logs.carmen_messages import FORMATS, parse_laser, parse_odometry, parse_parameter
from frontends.logs.errors import MalformedLineError
from frontends.logs.line_loop import LineTroubles, read_lines
from frontends.logs.text import Block, Line
from graph.limits import LIMITS

_MOST_TYPE = 7.0
"""A greater type of a laser might be the number of readings that an old RAWLASER message begins with."""
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


class _Room:
    """Where messages are read into, many at once, before they are kept; made anew for a larger block alone."""

    def __init__(self) -> None:
        self._rows: Rows | None = None

    def rows(self, n_bytes: int, n_beams: int) -> Rows:
        """For all messages that so many bytes can hold: a number takes two of them at least."""
        n, kept = n_bytes // (2 * n_beams + 8) + 1, self._rows
        if kept is None or len(kept.readings) < n or kept.readings.shape[1] != n_beams:
            readings = np.empty((n, n_beams), dtype=np.float32)
            self._rows = kept = Rows(readings=readings, poses=np.empty((n, 6)), stamps=np.empty((n, 2)))
        return kept


def collect(path: Path, names: tuple[str, ...], *, skip_bad_lines: bool) -> Records:
    """Go through the log once."""
    ranks = {name: rank for rank, name in enumerate(names)}
    best = len(names)
    records, room = Records(), _Room()
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

    @cache
    def only_counted(used: str, best: int) -> tuple[str, ...]:
        return tuple(name for name in _NAMES.values() if _is_only_counted(name, used, best, ranks))

    def read_many(block: Block, start: int) -> tuple[int, int]:
        return _record_many(records, block, start, only_counted(records.name, best), room, budget)

    read_lines(path, read, records.troubles, skip_bad_lines=skip_bad_lines, read_many=read_many)
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


def _record_many(
    records: Records, block: Block, start: int, only_counted: tuple[str, ...], room: _Room, budget: Budget
) -> tuple[int, int]:
    """Take in messages like the last one, for as long as they are plain, and count those between that are not used.

    Args:
        records: so far.
        block: lines …
        start: … from here on.
        only_counted: names of messages that are not used.
        room: for what is read.
        budget: of readings.

    Returns:
        How many lines that were, and where the first one begins that is neither.
    """
    layout = FORMATS.get(records.name)
    if layout is None or (layout.described and records.setups[-1].description is None):
        return 0, start
    setup = records.setups[-1]
    names = (records.name, *only_counted)
    rows = room.rows(len(block.text), setup.n_beams)
    counts = np.zeros(len(names) + 1, dtype=np.int64)
    plain = Plain(
        described=layout.described,
        n_poses=6 + layout.trailing if layout.posed else 0,
        description=np.array(setup.description or (0.0,) * 4),
        most=LIMITS.coordinate,
        most_heading=LIMITS.heading,
        most_stamp=LIMITS.stamp,
        most_type=inf if layout.posed else _MOST_TYPE,
    )
    position = scan_sweeps(block.bytes, start, *_packed(names), plain, rows, counts)
    met = counts.tolist()
    n = met[0]
    budget.take(setup.n_beams, n)
    records.ranges += list(rows.readings[:n].copy())
    records.poses += map(tuple, rows.poses[:n].tolist()) if layout.posed else [()] * n
    records.stamps += map(tuple, rows.stamps[:n].tolist())
    records.setups += [setup] * n
    for name, count in zip(names, met[:-1], strict=True):
        if count:
            records.counts[name] += count
    return sum(met), position


def _is_only_counted(name: str, used: str, best: int, ranks: dict[str, int]) -> bool:
    """Whether nothing is read of a message because a better one tells the same."""
    if name == "PARAM" or ranks.get(name, best + 1) <= best:
        return False
    return name != "ODOM" or _has_poses(used)


@cache
def _packed(names: tuple[str, ...]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Names as the rows of an array of bytes, and their lengths."""
    lengths = np.array([len(name) for name in names], dtype=np.int64)
    rows = b"".join(name.encode().ljust(int(lengths.max())) for name in names)
    return np.frombuffer(rows, dtype=np.uint8).reshape(len(names), -1), lengths


def _has_poses(used: str) -> bool:
    """Whether the messages that are used, if any, tell the odometry themselves."""
    return bool(used) and not used.startswith("RAWLASER")


def _record_odometry(records: Records, line: Line) -> None:
    if _has_poses(records.name):
        return
    records.odometry.append(parse_odometry(line))
    records.scans_before_odometry.append(len(records.ranges))


def _record_parameter(records: Records, line: Line) -> None:
    name, value = parse_parameter(line)
    records.parameters[name] = value
