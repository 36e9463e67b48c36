"""The messages of Player logs, line by line.

    ## Player version 1.6.5
    1100000000.510 robot 6665 position 00 1100000000.498 +01.200 -00.910 -1.501 +00.100 +00.000 +00.000 0
    1100000000.510 robot 6665 laser 00 1100000000.501 -1.5708 +1.5708 +.01745329 0181 3.212  0 3.195  0 …

    ## Player version 2.1.1
    0000000000.000 16777343 6665 laser 00 004 001  +0.030  +0.000   0.000   0.140   0.140
    1200000000.498 16777343 6665 position2d 00 001 001 +01.200 -00.910 -1.501 +00.100 +00.000 +00.000 0
    1200000000.501 16777343 6665 laser 00 001 001 0007 -1.5708 +1.5708 +0.01745329 +8.0000 0181 3.212  0 3.195  0 …
    1200000000.501 16777343 6665 laser 00 001 002 0007 x y θ -1.5708 +1.5708 +0.01745329 +8.0000 0181 3.212  0 …
    1200000000.501 16777343 6665 ranger 00 004 005 -1.5708 1.5708 0.017453 0.02 8.0 0.001 10.0
    1200000000.501 16777343 6665 ranger 00 001 001 0181 3.212 3.195 …

A line of Player 1 begins with the time of writing, host, port, interface, index and the time of the reading; one of
Player 2 and 3 with the time of the reading, host, robot, interface, index, type and subtype. Metres, radians and
seconds. A laser lists first and last bearing, step, longest range (not in Player 1) and count, then pairs of range and
intensity.
Source: manual of Player, drivers `writelog` of 1.6.5, 2.1 and 3.0.2.
"""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.logs.beams import BeamDescription
from frontends.logs.errors import MalformedLineError
from frontends.logs.number_fields import checked_pose, read_numbers
from frontends.logs.text import Line
from graph.limits import LIMITS

_HEAD = re.compile(
    rb"\s*(?P<time>\d+\.\d+)\s+(?P<host>\S+)\s+(?P<port>\d+)\s+(?P<interface>[a-z][a-z0-9]*)\s+(?P<index>\d+)\s+"
    rb"(?:(?P<taken>\d+\.\d+)|(?P<type>\d+)\s+(?P<subtype>\d+))(?=\s|$)"
)
RECOGNISED = re.compile(rb"^## Player version|" + _HEAD.pattern, re.MULTILINE)
"""Found in the beginning of a log."""
_POSITIONS = (b"position", b"position2d")
_DATA, _DATA_WITH_POSE, _GEOMETRY, _BEAMS = (1, 1), (1, 2), (4, 1), (4, 5)
"""Type and subtype."""
_FARTHEST_MOUNT = 100.0  # m: no robot is larger


class Device(NamedTuple):
    """A sensor.

    Attributes:
        robot: host and port.
        interface: "laser", "ranger", "position", "position2d" …
        number: of several of one robot.
    """

    robot: str
    interface: str
    number: int

    @property
    def name(self) -> str:
        """As Player's own files of settings name it."""
        return f"{self.interface}:{self.number}"


class Pose(NamedTuple):
    """Where a robot is by its odometry, x, y [m] and heading [rad]."""

    x: float
    y: float
    heading: float


class Mount(NamedTuple):
    """Where a laser sits on the robot, x, y [m] and heading [rad]."""

    x: float
    y: float
    heading: float


class Scan(NamedTuple):
    """One sweep.

    Attributes:
        ranges: (n,) [m].
        beams: what the message says of them; None where it leaves that to another.
        pose: of the robot, where the message has one.
    """

    ranges: NDArray[np.float32]
    beams: BeamDescription | None
    pose: Pose | None


class Message(NamedTuple):
    """One message.

    Attributes:
        device: whose.
        stamp: of the reading [s].
        said: what it says; the beams are those of a ranger, whose scans have none. None for what is not needed.
    """

    device: Device
    stamp: float
    said: Scan | Pose | Mount | BeamDescription | None


def parse_message(line: Line) -> Message | None:
    """Take a line apart; None for a blank line or a comment.

    Raises:
        MalformedLineError: the line breaks the format.
    """
    head = _HEAD.match(line.block, line.start, line.stop)
    if head is None:
        text = line.text.strip()
        if not text or text.startswith(b"#"):
            return None
        shown = text[:40].decode("ascii", "backslashreplace")
        raise MalformedLineError(f"'{shown}'", "a time, host, port, interface and index, and what they say")
    robot = f"{head['host'].decode('utf-8', 'replace')}:{head['port'].decode()}"
    device = Device(robot, head["interface"].decode(), int(head["index"][:9]))
    stamp = float(head["taken"] or head["time"])
    if not stamp <= LIMITS.stamp:
        raise MalformedLineError(f"the time {stamp}", f"at most {LIMITS.stamp:g} s")
    return Message(device, stamp, _said(line, head))


def _said(line: Line, head: re.Match[bytes]) -> Scan | Pose | Mount | BeamDescription | None:
    """What stands behind the head of a line."""
    interface, begin = head["interface"], head.end()
    kind = (int(head["type"][:9]), int(head["subtype"][:9])) if head["type"] else _DATA
    if interface in _POSITIONS and kind == _DATA:
        return Pose(*checked_pose(*_numbers(line, begin, 3).tolist()))
    if interface == b"laser" and kind == _DATA:
        return _laser_scan(_numbers(line, begin), (6, 5) if head["type"] else (4,))
    if interface == b"laser" and kind == _DATA_WITH_POSE:
        return _laser_scan(_numbers(line, begin), (9,))
    if interface == b"ranger" and kind in (_DATA, _DATA_WITH_POSE):
        return _ranger_scan(_numbers(line, begin))
    if interface == b"laser" and kind == _GEOMETRY:
        return _mount(*_numbers(line, begin, 3).tolist())
    if interface == b"ranger" and kind == _GEOMETRY:
        x, y, _, _, _, heading = _numbers(line, begin, 6).tolist()
        return _mount(x, y, heading)
    if interface == b"ranger" and kind == _BEAMS:
        first, last, step, _, longest = _numbers(line, begin, 5).tolist()
        return BeamDescription(first, last - first, step, longest)
    return None


def _numbers(line: Line, position: int, count: int | None = None) -> NDArray[np.float64]:
    """(n,) the first numbers behind the head of a line, all of them where it is not said how many."""
    n = len(line.block[position : line.stop].split()) if count is None else count
    numbers = np.empty(n)
    read_numbers(line, position, numbers, "of the message")
    return numbers


def _mount(x: float, y: float, heading: float) -> Mount:
    if not (max(abs(x), abs(y)) <= _FARTHEST_MOUNT and abs(heading) <= LIMITS.heading):
        raise MalformedLineError(f"{x} {y} {heading}", f"a finite mounting within {_FARTHEST_MOUNT:g} m of the robot")
    return Mount(x, y, heading)


def _laser_scan(numbers: NDArray[np.float64], heads: tuple[int, ...]) -> Scan:
    """A scan behind one of so many numbers, the last of which says how many pairs follow."""
    for n in heads:
        if len(numbers) >= n and numbers[n - 1] == (len(numbers) - n) / 2:
            first, last, step, longest = numbers[n - 5 : n - 1].tolist() if n > 4 else [*numbers[:3].tolist(), 0.0]
            pose = Pose(*checked_pose(*numbers[1:4].tolist())) if n > 6 else None
            return Scan(_checked(numbers[n::2]), BeamDescription(first, last - first, step, longest), pose)
    raise MalformedLineError(
        f"{len(numbers)} numbers", "angles, how many beams there are, and of each its range and intensity"
    )


def _ranger_scan(numbers: NDArray[np.float64]) -> Scan:
    """A scan that says how many ranges follow; others may come behind them."""
    n_ranges = numbers[0] if len(numbers) else 0.0
    if not 0 <= n_ranges <= len(numbers) - 1 or n_ranges != int(n_ranges):
        raise MalformedLineError(f"{len(numbers)} numbers", "how many ranges follow, and these")
    return Scan(_checked(numbers[1 : 1 + int(n_ranges)]), None, None)


def _checked(readings: NDArray[np.float64]) -> NDArray[np.float32]:
    if len(readings) > LIMITS.beams:
        raise MalformedLineError(f"{len(readings)} readings", f"at most {LIMITS.beams}")
    return readings.astype(np.float32)
