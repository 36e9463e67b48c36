"""The laser messages of CARMEN's log format, line by line.

    FLASER n [n ranges] laser_x laser_y laser_θ robot_x robot_y robot_θ STAMPS                       (also RLASER)
    ROBOTLASER1 type start_angle field_of_view resolution max_range accuracy remission_mode
        n [n ranges] m [m remissions] laser_x laser_y laser_θ robot_x robot_y robot_θ
        tv rv forward_safety side_safety turn_axis STAMPS
    RAWLASER1 type start_angle field_of_view resolution max_range accuracy remission_mode
        n [n ranges] m [m remissions] STAMPS
    RAWLASER1 n [n ranges] STAMPS                                                                    (old form)
    ODOM x y θ tv rv acceleration STAMPS
    PARAM name value STAMPS
    SYNC tag STAMPS

STAMPS are `ipc_timestamp host logger_timestamp`, in seconds. Source: CARMEN 0.7, `readlog.c`.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.logs.beams import BeamDescription
from frontends.logs.errors import MalformedLineError
from frontends.logs.number_fields import checked_pose, read_numbers
from frontends.logs.text import Line
from graph.limits import LIMITS

_COUNT_DIGITS = 6  # fewer are no more beams than are allowed
_STAMPS = "the stamps 'ipc_timestamp host logger_timestamp'"


class LaserMessage(NamedTuple):
    """One sweep as its line has it.

    Attributes:
        ranges: (n_beams,) float32 as recorded [m], right to left.
        poses: laser x, y, θ and robot x, y, θ [m, rad]; empty where the message carries none.
        stamp: of the message [s].
        logger_stamp: since the logger started [s].
        beams: the laser's own description; None where the message has none.
    """

    ranges: NDArray[np.float32]
    poses: tuple[float, ...]
    stamp: float
    logger_stamp: float
    beams: BeamDescription | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserFormat:
    """What surrounds the ranges in one family of messages."""

    described: bool  # the message begins with the laser's description and has remissions
    posed: bool  # laser and robot pose follow
    trailing: int  # numbers between the poses and the stamps


FORMATS: dict[str, LaserFormat] = {
    "FLASER": LaserFormat(described=False, posed=True, trailing=0),
    "RLASER": LaserFormat(described=False, posed=True, trailing=0),
} | {
    f"{family}{number}": layout
    for family, layout in (
        ("ROBOTLASER", LaserFormat(described=True, posed=True, trailing=5)),
        ("RAWLASER", LaserFormat(described=True, posed=False, trailing=0)),
    )
    for number in range(10)
}
"""Every message that holds a sweep."""


def parse_laser(line: Line, name: str) -> LaserMessage:
    """Read a laser message.

    Args:
        line: where it stands.
        name: its first word, one of `FORMATS`.

    Raises:
        MalformedLineError: the line breaks the format.
    """
    layout = FORMATS[name]
    described = layout.described and not _is_old_form(line, layout)
    position = line.block.index(name.encode(), line.start) + len(name)
    beams = None
    if described:
        head = np.empty(7)
        position = read_numbers(line, position, head, "of the laser's description")
        beams = BeamDescription(*_finite(head[1:5], "a finite description of the laser"))
    n_beams, position = _count(line, position, "num_readings")
    ranges = np.empty(n_beams)
    position = read_numbers(line, position, ranges, "of the ranges")
    if described:
        n_remissions, position = _count(line, position, "num_remissions")
        position = read_numbers(line, position, np.empty(n_remissions), "of the remissions")
    poses: tuple[float, ...] = ()
    if layout.posed:
        pair = np.empty(6 + layout.trailing)
        position = read_numbers(line, position, pair, "of the laser and robot pose")
        values = pair.tolist()
        poses = *checked_pose(*values[:3]), *checked_pose(*values[3:6])
    stamp, logger_stamp = _stamps(line, position)
    return LaserMessage(ranges.astype(np.float32), poses, stamp, logger_stamp, beams)


def parse_odometry(line: Line) -> tuple[float, ...]:
    """The robot pose x, y, θ [m, rad] of an ODOM message.

    Raises:
        MalformedLineError: the line breaks the format.
    """
    values = np.empty(6)
    position = read_numbers(line, line.block.index(b"ODOM", line.start) + 4, values, "of 'x y θ tv rv acceleration'")
    pose = checked_pose(*values[:3].tolist())
    _stamps(line, position)
    return pose


def parse_parameter(line: Line) -> tuple[str, str]:
    """Name and value of a PARAM message.

    Raises:
        MalformedLineError: the line breaks the format.
    """
    words = line.text.decode("utf-8", "replace").split()
    if len(words) < 3:
        raise MalformedLineError(f"{len(words) - 1} words after PARAM", "a name and a value")
    return words[1], words[2]


def _is_old_form(line: Line, layout: LaserFormat) -> bool:
    """Whether a RAWLASER line is of the old form, which has its number of readings first and no description."""
    if layout.posed:
        return False
    words = line.text.split()
    is_count = len(words) > 1 and words[1].isdigit() and len(words[1]) < _COUNT_DIGITS
    return is_count and len(words) == 1 + 1 + int(words[1]) + 3


def _count(line: Line, position: int, what: str) -> tuple[int, int]:
    end = line.block.find(b" ", position + 1, line.stop)
    digits = line.block[position + 1 : end] if end >= 0 else b""
    if digits.isdigit() and len(digits) < _COUNT_DIGITS and int(digits) <= LIMITS.beams:
        return int(digits), end
    number = np.empty(1)
    position = read_numbers(line, position, number, what)
    count = float(number[0])
    if not 0 <= count <= LIMITS.beams or not count.is_integer():
        raise MalformedLineError(f"{what} {count:g}", f"a whole number from 0 to {LIMITS.beams}")
    return int(count), position


def _finite(values: NDArray[np.float64], expected: str) -> tuple[float, ...]:
    numbers: tuple[float, ...] = tuple(values.tolist())
    if not all(map(math.isfinite, numbers)):
        raise MalformedLineError(" ".join(map(str, numbers)), expected)
    return numbers


def _stamps(line: Line, position: int) -> tuple[float, float]:
    words = line.block[position : line.stop].split()
    try:
        stamp, _, logger_stamp = words
        stamps = float(stamp), float(logger_stamp)
    except ValueError:
        shown = b" ".join(words)[:60].decode("ascii", "backslashreplace")
        raise MalformedLineError(f"'{shown}' after the other fields", _STAMPS) from None
    if not (abs(stamps[0]) <= LIMITS.stamp and abs(stamps[1]) <= LIMITS.stamp):
        raise MalformedLineError(
            f"the stamps {stamps[0]} and {stamps[1]}", f"finite numbers of at most {LIMITS.stamp:g} s"
        )
    return stamps
