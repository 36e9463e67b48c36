"""Writing a log as CARMEN's laser messages, which every tool of the field reads."""

import gzip
import io
import os
import tempfile
from pathlib import Path

import numpy as np

from frontends.logs.beams import Setup, find_beams
from frontends.logs.errors import LogError
from frontends.scan import Log, ScanGeometry
from graph.se2 import compose

NO_RETURN = 81.83
"""What is written where a beam had no return [m]: a SICK LMS's own mark, beyond what any tool takes for a wall."""

_HEADER = "# CARMEN log\n"


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
    text = _text(log, range_decimals).encode("ascii")
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_compressed(text) if path.suffix == ".gz" else text)
            Path(temporary).chmod(0o644)
            Path(temporary).replace(path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise LogError(f"{path}: cannot be written ({error.strerror or error})") from error


def _text(log: Log, range_decimals: int) -> str:
    ranges = np.where(np.isfinite(log.ranges), log.ranges, NO_RETURN)
    T_odom_laser = compose(log.odometry, log.geometry.T_robot_laser)
    stamps = np.column_stack([log.stamps, log.stamps - log.stamps[:1]])
    line = _line_format(log.geometry, range_decimals)
    rows = np.column_stack([ranges, T_odom_laser, log.odometry, stamps])
    return _HEADER + "".join(line % tuple(row) for row in rows.tolist())


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


def _compressed(text: bytes) -> bytes:
    """Gzip without name and time of day: the same log gives the same bytes."""
    buffer = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", fileobj=buffer, mtime=0) as file:
        file.write(text)
    return buffer.getvalue()
