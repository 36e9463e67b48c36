"""DP-SLAM's own logs: odometry and laser in turn, nothing else.

    Odometry x y θ
    Laser n r1 … rn

The pose is the robot's [m, rad]; the readings [m] run from right to left. A Laser line belongs to the Odometry line
before it. There are no stamps, no bearings and no word on where the laser sits. Source: README of DP-SLAM 0.1.1
(Eliazar and Parr, Duke University), which writes the keywords in capitals; both are read.
"""

import math
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from frontends.logs import laser_mount
from frontends.logs.beams import Setup, find_beams, stack_sweeps, usual_setup
from frontends.logs.budget import Budget, check_stack
from frontends.logs.errors import LogError, MalformedLineError
from frontends.logs.line_loop import LineTroubles, read_lines
from frontends.logs.plausibility import check_steps, judge_odometry
from frontends.logs.text import Line
from frontends.logs.text_output import write_text_log
from frontends.logs.usable_range import mask_no_returns, usable_range, warn_of_no_returns
from frontends.scan import Log, ScanGeometry
from graph.limits import LIMITS
from graph.se2 import wrap_angle

__all__ = ["is_dpslam", "read_dpslam", "write_dpslam"]

NO_RETURN = 8.183
"""What is written where a beam had no return [m]: a SICK LMS's own mark while it measures in millimetres."""
FAR_NO_RETURN = 81.83
"""The same while it measures in centimetres, for lasers that reach beyond 8 m."""

_MILLIMETRE_CODES = (8.1825, 8.1915)  # 13 bits less the nine error codes at their top
_ODOMETRY, _LASER = b"odometry", b"laser"
_MOUNT = (0.40, 0.0, 0.0)  # of the authors' ATRV Jr; matches of its loop5 log with its odometry say 0.39 m

_ASSUMED_MOUNT = f"the log {laser_mount.SILENT}: {_MOUNT[0]:g} m ahead of the robot's centre, as on DP-SLAM's own robot"


def is_dpslam(head: bytes) -> bool:
    """Whether a file that begins with `head` is a DP-SLAM log: one of its whole lines is one of the two messages."""
    return any(
        words and words[0].lower() in {_ODOMETRY, _LASER}
        for words in (line.split(None, 1) for line in head.split(b"\n"))
    )


def read_dpslam(
    path: Path | str,
    *,
    laser: str = "front",
    range_min: float | None = None,
    range_max: float | None = None,
    T_robot_laser: ArrayLike | None = None,
    skip_bad_lines: bool = False,
) -> Log:
    """Read a DP-SLAM log, plain or compressed, block by block.

    Scans are numbered 0, 1, 2 … in place of stamps. Beams follow from their number as in `find_beams`; scans with
    another number of beams than most are placed on the bearings of those. `usable_range` tells how no-return readings
    are recognised; here SICK's marks in millimetres (8.183 m to 8.191 m) are known as well. Lines that begin with #
    are comments. A last line that was cut off is a warning.

    Args:
        path: the log.
        laser: "front": these logs know no other.
        range_min: shortest return [m]; None for 2 cm.
        range_max: longest return [m]; None to derive it from the log.
        T_robot_laser: (3,) where the laser sits, which the format does not say; None for the authors' own robot.
        skip_bad_lines: pass over malformed lines, and scans whose odometry is missing, and count them.

    Raises:
        LogError: the file cannot be read, a line is malformed, or there is no scan in it.
    """
    path = Path(path)
    if laser != "front":
        raise LogError(f"{path}: no laser is called '{laser}': a DP-SLAM log holds one, expected 'front'")
    records = _collect(path, skip_bad_lines=skip_bad_lines)
    odometry, kept = _poses(path, records, skip_bad_lines=skip_bad_lines)
    records.ranges = [records.ranges[index] for index in kept]
    return _assemble(path, records, odometry, range_min, range_max, T_robot_laser)


def write_dpslam(path: Path | str, log: Log, *, range_decimals: int = 6) -> None:
    """Write a log, compressed when `path` ends with .gz.

    Stamps and the laser's place on the robot are lost: the format has no room for them.

    Args:
        path: replaced as a whole when all is written.
        log: what to write.
        range_decimals: decimals of a range [m].

    Raises:
        LogError: the file cannot be written, or the bearings are not those that follow from the number of beams.
    """
    path = Path(path)
    expected = find_beams(Setup(log.geometry.n_beams, None), {}).bearings
    if not np.allclose(expected, log.geometry.bearings, rtol=0.0, atol=1e-9):
        raise LogError(
            f"{path}: found beams from {math.degrees(log.geometry.bearings[0]):g}° to"
            f" {math.degrees(log.geometry.bearings[-1]):g}°, expected {math.degrees(expected[0]):g}° to"
            f" {math.degrees(expected[-1]):g}°: a DP-SLAM log cannot say where its {len(expected)} beams point"
        )
    write_text_log(path, [_text(log, range_decimals)])


@dataclass(slots=True)
class _Records:
    """What the lines held: per scan its readings, the number of its line and the pose before it, if there was one."""

    ranges: list[NDArray[np.float32]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    poses: list[tuple[float, float, float] | None] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    troubles: LineTroubles = field(default_factory=LineTroubles)


def _collect(path: Path, *, skip_bad_lines: bool) -> _Records:
    """Go through the log once."""
    records = _Records()
    budget = Budget(path)
    pose: tuple[float, float, float] | None = None

    def read(line: Line) -> None:
        nonlocal pose
        keyword = _keyword(line)
        if keyword == _ODOMETRY:
            pose = _parse_odometry(line)
            records.counts["Odometry"] += 1
        elif keyword == _LASER:
            records.ranges.append(_parse_laser(line))
            budget.take(len(records.ranges[-1]))
            records.lines.append(line.number)
            records.poses.append(pose)
            records.counts["Laser"] += 1
            pose = None

    read_lines(path, read, records.troubles, skip_bad_lines=skip_bad_lines)
    return records


def _keyword(line: Line) -> bytes:
    """The first word in lower case, empty for a comment or a blank line."""
    words = line.text.split(None, 1)
    if not words or words[0].startswith(b"#"):
        return b""
    keyword = words[0].lower()
    if keyword not in {_ODOMETRY, _LASER}:
        shown = words[0][:40].decode("ascii", "backslashreplace")
        raise MalformedLineError(f"'{shown}'", "Odometry, Laser or a comment with #")
    return keyword


def _parse_odometry(line: Line) -> tuple[float, float, float]:
    pose = np.empty(3)
    _end(line, _numbers(line, _behind(line), pose, "of the pose 'x y θ'"), "the pose")
    from frontends.logs.number_fields import checked_pose

    return checked_pose(*pose.tolist())


def _parse_laser(line: Line) -> NDArray[np.float32]:
    number = np.empty(1)
    position = _numbers(line, _behind(line), number, "the number of readings")
    count = float(number[0])
    if not 0 <= count <= LIMITS.beams or not count.is_integer():
        raise MalformedLineError(f"{count:g} readings", f"a whole number from 0 to {LIMITS.beams}")
    ranges = np.empty(int(count))
    _end(line, _numbers(line, position, ranges, "of the readings"), "the readings")
    return ranges.astype(np.float32)


def _behind(line: Line) -> int:
    """Position behind the keyword in the block."""
    keyword = line.text.split(None, 1)[0]
    return line.block.index(keyword, line.start) + len(keyword)


def _numbers(line: Line, position: int, out: NDArray[np.float64], what: str) -> int:
    from frontends.logs.number_fields import read_numbers

    return read_numbers(line, position, out, what)


def _end(line: Line, position: int, what: str) -> None:
    rest = line.block[position : line.stop].split(None, 1)
    if rest:
        raise MalformedLineError(
            f"'{rest[0][:40].decode('ascii', 'backslashreplace')}' after {what}", "the end of the line"
        )
    if not line.terminated:
        raise MalformedLineError("no end of line", "one, without which the last number may be cut off")


def _assemble(
    path: Path,
    records: _Records,
    odometry: NDArray[np.float64],
    range_min: float | None,
    range_max: float | None,
    T_robot_laser: ArrayLike | None,
) -> Log:
    """The log of the scans that have odometry."""
    setups = [Setup(len(ranges), None) for ranges in records.ranges]
    usual = usual_setup(setups)
    if usual is None:
        raise LogError(f"{path}: {_why_no_scans(records)}")
    check_stack(path, len(setups), usual.n_beams)
    check_steps(path, odometry)
    ranges, bearings, beam_warnings = stack_sweeps(records.ranges, setups, usual, {})
    usable = usable_range(ranges, range_min=range_min, range_max=range_max, stated_max=_stated_max(ranges))
    mask_no_returns(ranges, usable)
    has_odometry, odometry_warnings = judge_odometry(odometry, ranges, None)
    return Log(
        ranges=ranges,
        odometry=odometry,
        stamps=np.arange(len(ranges), dtype=np.float64),
        geometry=ScanGeometry(
            bearings=bearings,
            range_min=usable.range_min,
            range_max=usable.range_max,
            T_robot_laser=np.array(_MOUNT if T_robot_laser is None else T_robot_laser, dtype=np.float64),
        ),
        path=path,
        has_odometry=has_odometry,
        is_mount_known=T_robot_laser is not None,
        warnings=(
            *records.troubles.told(),
            *beam_warnings,
            *warn_of_no_returns(ranges, usable),
            "the log has no stamps: scans are numbered 0, 1, 2 … s instead",
            *(() if T_robot_laser is not None else (_ASSUMED_MOUNT,)),
            *odometry_warnings,
        ),
        skipped_lines=records.troubles.skipped,
        message_counts=dict(sorted(records.counts.items())),
    )


def _poses(path: Path, records: _Records, *, skip_bad_lines: bool) -> tuple[NDArray[np.float64], list[int]]:
    """(n, 3) T_odom_robot and which n scans have one; zeros for all scans where the log has no odometry at all."""
    if not any(pose is not None for pose in records.poses):
        return np.zeros((len(records.poses), 3)), list(range(len(records.poses)))
    kept = []
    for index, (number, pose) in enumerate(zip(records.lines, records.poses, strict=True)):
        if pose is not None:
            kept.append(index)
            continue
        error = MalformedLineError("a Laser line without an Odometry line of its own", "Odometry x y θ before it")
        if not skip_bad_lines:
            raise error.at(path, number)
        records.troubles.skip(error.at(path, number))
    odometry = np.array([records.poses[index] for index in kept], dtype=np.float64)
    odometry[:, 2] = wrap_angle(odometry[:, 2])
    return odometry, kept


def _stated_max(readings: NDArray[np.float32]) -> float:
    """Where SICK's error codes in millimetres begin, if the longest reading is one of them."""
    finite = readings[np.isfinite(readings)]
    longest = float(finite.max()) if len(finite) else 0.0
    return _MILLIMETRE_CODES[0] if _MILLIMETRE_CODES[0] <= longest <= _MILLIMETRE_CODES[1] else np.inf


def _why_no_scans(records: _Records) -> str:
    if records.counts["Laser"]:
        reason = "no Laser line has two readings or more, which a scan in the plane needs"
    else:
        reason = f"no Laser line found, only {records.counts['Odometry']} Odometry lines"
    return "; ".join([reason, *records.troubles.told()])


def _text(log: Log, range_decimals: int) -> str:
    no_return = NO_RETURN if log.geometry.range_max < _MILLIMETRE_CODES[0] else FAR_NO_RETURN
    ranges = np.where(np.isfinite(log.ranges), log.ranges, no_return)
    readings = " ".join([f"%.{range_decimals}f"] * log.geometry.n_beams)
    lines = f"Odometry %.6f %.6f %.9f\nLaser {log.geometry.n_beams} {readings}\n"
    return "".join(lines % tuple(row) for row in np.column_stack([log.odometry, ranges]).tolist())
