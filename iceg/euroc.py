"""Trajectories in the EuRoC format: a CSV of `stamp [ns], x, y, z, qw, qx, qy, qz`."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from iceg.tables import check_row, open_table
from iceg.tum import Trajectory, TrajectoryError, format_tum, in_the_plane, parse_pose

_HEADER = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
_COLUMNS = "timestamp [ns], x, y, z, qw, qx, qy, qz"
_N_COLUMNS = 8
_NANOSECONDS = 1e9


def is_euroc_header(line: str) -> bool:
    """Whether a line is the header of a EuRoC table."""
    return line.startswith("#") and line[1:].lstrip().lower().startswith("timestamp") and "," in line


def format_euroc(stamps: NDArray[np.float64], poses: NDArray[np.float64]) -> str:
    """The text of a EuRoC table.

    Args:
        stamps: (n,) seconds; written to a microsecond, in nanoseconds.
        poses: (n, 3) T_map_robot.

    Returns:
        The header and n lines; positions to a nanometre, quaternions to 12 decimals.

    Raises:
        TrajectoryError: the lengths differ or a number is not finite.
    """
    lines = [_HEADER]
    for row in format_tum(stamps, poses).splitlines():
        stamp, x, y, z, qx, qy, qz, qw = row.split(" ")
        whole, _, decimals = stamp.partition(".")
        nanoseconds = int(f"{whole}{decimals}000")
        lines.append(",".join((str(nanoseconds), x, y, z, qw, qx, qy, qz)))
    return "\n".join(lines) + "\n"


def read_euroc(path: Path | str) -> Trajectory:
    """Read a EuRoC table of poses, such as `state_groundtruth_estimate0/data.csv`; what leaves the plane is dropped.

    Args:
        path: what a row holds behind the eighth number (velocities, biases) is passed over, and so are lines that
            start with `#`.

    Returns:
        The poses in file order.

    Raises:
        TrajectoryError: the file cannot be read, holds no pose, or a row does not begin with 8 finite numbers.
    """
    path = Path(path)
    rows: list[list[float]] = []
    with open_table(path, TrajectoryError, "a EuRoC trajectory", "utf-8-sig") as file:
        for number, line in enumerate(file, 1):
            if line.strip() and not line.startswith("#"):
                check_row(len(rows) + 1, f"{path}:{number}", TrajectoryError)
                rows.append(_parse(path, number, [word.strip() for word in line.split(",")]))
    if not rows:
        raise TrajectoryError(f"{path}: holds no pose, expected rows '{_COLUMNS}'")
    return in_the_plane(np.array(rows))


def _parse(path: Path, number: int, words: list[str]) -> list[float]:
    if len(words) < _N_COLUMNS:
        raise TrajectoryError(f"{path}:{number}: found {len(words)} values, expected at least 8: '{_COLUMNS}'")
    stamp, x, y, z, qw, qx, qy, qz = words[:_N_COLUMNS]
    return parse_pose(path, number, [stamp, x, y, z, qx, qy, qz, qw], _COLUMNS, _NANOSECONDS)
