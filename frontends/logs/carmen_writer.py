"""Writing a log as CARMEN's laser messages, which every tool of the field reads."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from frontends.logs.beams import Setup, find_beams
from frontends.logs.errors import LogError
from frontends.logs.text_output import write_text_log
from frontends.scan import Log, ScanGeometry
from graph.se2 import compose

NO_RETURN = 81.83
"""What is written where a beam had no return [m]: a SICK LMS's own mark, beyond what any tool takes for a wall."""

_HEADER = "# CARMEN log\n"
_FLASER_FIELDS = (
    "# FLASER num_readings [ranges] x y theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp\n"
)
_BLOCK = 1024  # scans


def write_carmen(path: Path | str, log: Log, *, range_decimals: int = 3) -> None:
    """Write a log, compressed when `path` ends with .gz.

    FLASER lines carry laser pose, robot pose and stamps, but no bearings: those follow from the number of beams. A
    laser whose bearings do not is written as ROBOTLASER1, which has its first bearing and step.

    Args:
        path: replaced as a whole when all is written.
        log: what to write.
        range_decimals: decimals of a range [m].

    Raises:
        LogError: the file cannot be written, or the beams are not evenly spread, for which there is no message.
    """
    path = Path(path)
    if not np.allclose(np.diff(log.geometry.bearings, 2), 0.0, atol=1e-9):
        raise LogError(f"{path}: found unevenly spread beams, expected the same step between all of them")
    write_text_log(path, _text(log, range_decimals))


def _text(log: Log, range_decimals: int) -> Iterator[str]:
    """The lines, a block of scans at a time."""
    line = _line_format(log.geometry, range_decimals)
    yield _HEADER + (_FLASER_FIELDS if line.startswith("FLASER") else "")
    for start in range(0, len(log), _BLOCK):
        block = slice(start, start + _BLOCK)
        ranges = np.where(np.isfinite(log.ranges[block]), log.ranges[block], NO_RETURN)
        T_odom_laser = compose(log.odometry[block], log.geometry.T_robot_laser)
        stamps = np.column_stack([log.stamps[block], log.stamps[block] - log.stamps[:1]])
        rows = np.column_stack([ranges, T_odom_laser, log.odometry[block], stamps])
        yield "".join(line % tuple(row) for row in rows.tolist())


def _line_format(geometry: ScanGeometry, range_decimals: int) -> str:
    """The format of a line for its ranges, laser pose, robot pose and two stamps."""
    n_beams = geometry.n_beams
    ranges = [f"%.{range_decimals}f"] * n_beams
    poses = ["%.6f"] * 6
    stamps = ["%.6f", "iceg", "%.6f"]
    if np.allclose(find_beams(Setup(n_beams, None), {}).bearings, geometry.bearings, rtol=0.0, atol=1e-9):
        words = ["FLASER", str(n_beams), *ranges, *poses, *stamps]
    else:
        beams = [f"{angle:.12f}" for angle in (geometry.bearings[0], geometry.field_of_view, geometry.resolution)]
        description = ["0", *beams, str(NO_RETURN), "0.01", "0"]
        no_speeds_and_safety_distances = ["0"] * 5
        words = [
            "ROBOTLASER1",
            *description,
            str(n_beams),
            *ranges,
            "0",
            *poses,
            *no_speeds_and_safety_distances,
            *stamps,
        ]
    return " ".join(words) + "\n"
