"""Writing a log as CARMEN's FLASER lines, which every tool of the field reads."""

import gzip
import io
import os
import tempfile
from pathlib import Path

import numpy as np

from frontends.logs.errors import LogError
from frontends.scan import Log
from graph.se2 import compose, wrap_angle

NO_RETURN = 81.83
"""What is written where a beam had no return [m]: a SICK LMS's own mark, beyond what any tool takes for a wall."""

_HEADER = """\
# CARMEN log
# FLASER num_readings [ranges] x y theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp
"""


def write_carmen(path: Path | str, log: Log, *, range_decimals: int = 3) -> None:
    """Write a log as FLASER lines: laser pose, then robot pose, then stamps. Compressed when `path` ends with .gz.

    The format has no place for bearings: they are right only for the beam numbers `read_carmen` knows, others must
    spread over 180°.

    Args:
        path: replaced as a whole when all is written.
        log: what to write.
        range_decimals: decimals of a range [m].

    Raises:
        LogError: the file cannot be written.
    """
    path = Path(path)
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
    n_beams = log.geometry.n_beams
    ranges = np.where(np.isfinite(log.ranges), log.ranges, NO_RETURN)
    T_odom_laser = compose(log.odometry, log.geometry.T_robot_laser)
    T_odom_laser[:, 2] = wrap_angle(T_odom_laser[:, 2])
    stamps = np.column_stack([log.stamps, log.stamps - log.stamps[:1]])
    line = " ".join(["FLASER", str(n_beams), *[f"%.{range_decimals}f"] * n_beams, *["%.6f"] * 7, "iceg", "%.6f"])
    rows = np.column_stack([ranges, T_odom_laser, log.odometry, stamps])
    return _HEADER + "".join(f"{line % tuple(row)}\n" for row in rows.tolist())


def _compressed(text: bytes) -> bytes:
    """Gzip without name and time of day: the same log gives the same bytes."""
    buffer = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", fileobj=buffer, mtime=0) as file:
        file.write(text)
    return buffer.getvalue()
