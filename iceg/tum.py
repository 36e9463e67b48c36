"""Trajectories in the TUM format: `t x y z qx qy qz qw`, one line per scan (evo and others read it)."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graph.elementary import arctan2, cos_sin
from graph.errors import IcegError
from graph.limits import LIMITS
from graph.short_repr import short_repr
from iceg.tables import check_row, first_that_is_no_number, open_table

_LINE = "%.6f %.9f %.9f 0 0 0 %.12f %.12f\n"
_N_COLUMNS = 8


class TrajectoryError(IcegError):
    """A trajectory that cannot be read or written."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trajectory:
    """Stamped poses in file order.

    Attributes:
        stamps: (n,) seconds; may step back.
        poses: (n, 3) T_map_robot: x [m], y [m], heading [rad] in (−π, π].
    """

    stamps: NDArray[np.float64]
    poses: NDArray[np.float64]

    __repr__ = short_repr

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.poses)


def format_tum(stamps: NDArray[np.float64], poses: NDArray[np.float64]) -> str:
    """The text of a TUM file.

    Args:
        stamps: (n,) seconds.
        poses: (n, 3) T_map_robot.

    Returns:
        n lines; positions to a nanometre, quaternions to 12 decimals.

    Raises:
        TrajectoryError: the lengths differ or a number is not finite.
    """
    if poses.shape != (len(stamps), 3):
        raise TrajectoryError(f"a trajectory needs 3 numbers per stamp, found {poses.shape} for {len(stamps)} stamps")
    cos, sin = cos_sin(poses[:, 2] / 2)
    # Adding 0.0 turns −0.0 into 0.0, so that equal poses give equal bytes.
    columns = np.column_stack([stamps, poses[:, :2], sin, cos]) + 0.0
    bad = np.flatnonzero(~np.isfinite(columns).all(axis=1))
    if len(bad):
        raise TrajectoryError(f"pose {bad[0]} of the trajectory is not finite: {stamps[bad[0]]}, {poses[bad[0]]}")
    return (_LINE * len(columns)) % tuple(columns.ravel().tolist())


def read_tum(path: Path | str) -> Trajectory:
    """Read a TUM file; what leaves the plane (z, roll, pitch) is dropped.

    Args:
        path: the file; lines starting with `#` are comments.

    Returns:
        The poses in file order.

    Raises:
        TrajectoryError: the file cannot be read, holds no pose, or a line is not 8 finite numbers.
    """
    path = Path(path)
    rows: list[list[float]] = []
    with open_table(path, TrajectoryError, "a TUM trajectory") as file:
        for number, line in enumerate(file, 1):
            row = line.split()
            if row and not row[0].startswith("#"):
                check_row(len(rows) + 1, f"{path}:{number}", TrajectoryError)
                rows.append(parse_pose(path, number, row))
    if not rows:
        raise TrajectoryError(f"{path}: holds no pose, expected lines 't x y z qx qy qz qw'")
    return in_the_plane(np.array(rows))


def in_the_plane(table: NDArray[np.float64]) -> Trajectory:
    """The trajectory of (n, 8) rows t, x, y, z, qx, qy, qz, qw; what leaves the plane is dropped."""
    x, y, z, w = table[:, 4:8].T
    # Homogeneous in the quaternion, so that a rounded norm does no harm.
    heading = arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return Trajectory(stamps=table[:, 0], poses=np.column_stack([table[:, 1:3], heading]))


def parse_pose(
    path: Path, number: int, row: list[str], columns: str = "t x y z qx qy qz qw", units_per_second: float = 1.0
) -> list[float]:
    """The numbers of one row.

    Args:
        path: the file, for messages.
        number: the line, likewise.
        row: words in TUM's order.
        columns: what the file has, for messages.
        units_per_second: of the stamp as written.

    Returns:
        Eight numbers in TUM's order, the stamp in seconds.

    Raises:
        TrajectoryError: they are not 8 finite numbers, or no rotation.
    """
    try:
        values = [float(word) for word in row]
    except ValueError as err:
        raise TrajectoryError(f"{path}:{number}: found '{first_that_is_no_number(row)}', expected '{columns}'") from err
    if len(values) != _N_COLUMNS:
        raise TrajectoryError(f"{path}:{number}: found {len(values)} numbers, expected 8: '{columns}'")
    values[0] /= units_per_second
    if not np.isfinite(values).all() or not 1e-3 <= math.hypot(*values[4:]) <= 1e3:
        raise TrajectoryError(
            f"{path}:{number}: found '{' '.join(row)[:200]}', expected finite numbers and a unit quaternion"
        )
    if abs(values[0]) > LIMITS.stamp or max(map(abs, values[1:4])) > LIMITS.coordinate:
        raise TrajectoryError(
            f"{path}:{number}: found '{' '.join(row)[:200]}', expected a stamp of at most {LIMITS.stamp:g} s and a "
            f"place within {LIMITS.coordinate:g} m of the origin"
        )
    return values
