"""Absolute trajectory error: what is left after a trajectory is laid over its reference."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graph.se2 import compose, transform_points, wrap_angle
from iceg.evaluation.errors import EvaluationError
from iceg.tables import read_csv_table

REFERENCE_COLUMNS = ("scan", "x_m", "y_m", "theta_rad")
TRUTH_COLUMNS = ("t_s", "x_m", "y_m", "theta_rad")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryErrors:
    """What is left between aligned poses, in the axes of the reference.

    Attributes:
        n: number of poses compared.
        ate_rmse: root mean square distance [m].
        ate_max: largest distance [m].
        x_mean_abs: mean absolute error along the reference's x [m].
        y_mean_abs: the same along y [m].
        x_var: variance of the error along x [m²].
        y_var: the same along y [m²].
        rot_rmse: root mean square heading error [rad].
    """

    n: int
    ate_rmse: float
    ate_max: float
    x_mean_abs: float
    y_mean_abs: float
    x_var: float
    y_var: float
    rot_rmse: float


def read_reference_csv(path: Path | str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read reference poses of some scans.

    Args:
        path: a CSV with the header `scan,x_m,y_m,theta_rad`.

    Returns:
        (n,) scan indices counted from 0 in file order, and (n, 3) their poses.

    Raises:
        TableError: the file cannot be read or is not as expected.
        EvaluationError: what should name a scan does not.
    """
    path = Path(path)
    table = read_csv_table(path, REFERENCE_COLUMNS)
    scans = table[:, 0]
    check_scan_numbers(scans, path)
    return scans.astype(np.int64), table[:, 1:]


def read_truth_csv(path: Path | str) -> NDArray[np.float64]:
    """Read the true pose of every scan, without its stamps.

    Args:
        path: a CSV with the header `t_s,x_m,y_m,theta_rad`, one row per scan in file order.

    Returns:
        (n_scans, 3) T_world_robot.

    Raises:
        TableError: the file cannot be read or is not as expected.
    """
    return read_stamped_csv(path)[1]


def read_stamped_csv(path: Path | str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The (n,) stamps [s] of the same file, and its (n, 3) poses.

    Raises:
        TableError: as `read_truth_csv`.
    """
    table = read_csv_table(Path(path), TRUTH_COLUMNS)
    return table[:, 0], table[:, 1:]


def poses_of_scans(T_map_robot: NDArray[np.float64], scans: NDArray[np.int64], path: Path) -> NDArray[np.float64]:
    """The poses of the scans a reference names.

    Args:
        T_map_robot: (n_scans, 3), one pose per scan.
        scans: (n,) scan indices.
        path: the reference, for the message.

    Raises:
        EvaluationError: the reference reaches beyond the trajectory.
    """
    if scans.max() >= len(T_map_robot):
        raise EvaluationError(
            f"{path}: reaches scan {scans.max()}, but the trajectory has {len(T_map_robot)} rows; "
            "expected one row per scan of the same log"
        )
    return T_map_robot[scans]


def check_scan_numbers(scans: NDArray[np.float64], path: Path) -> None:
    """Refuse a table whose rows (n,) or (n, m) name scans by anything but whole numbers counted from 0.

    Raises:
        EvaluationError: naming the file, the row below its header, and what was found.
    """
    bad = np.argwhere((scans != np.floor(scans)) | (scans < 0))
    if len(bad):
        found = scans[tuple(bad[0])]
        raise EvaluationError(f"{path}: row {bad[0][0] + 1}: found scan {found:g}, expected whole numbers from 0")


def check_one_row_per_scan(T_map_robot: NDArray[np.float64], T_world_robot: NDArray[np.float64], path: Path) -> None:
    """Refuse a truth that has another number of rows than the trajectory.

    Args:
        T_map_robot: (n, 3) the trajectory.
        T_world_robot: (m, 3) the truth.
        path: the file of the truth, for the message.

    Raises:
        EvaluationError: the numbers differ.
    """
    if len(T_map_robot) != len(T_world_robot):
        raise EvaluationError(
            f"{path}: holds {len(T_world_robot)} poses, the trajectory {len(T_map_robot)}; "
            "expected one row per scan in both"
        )


def align(estimated: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rigid motion that lays estimated positions over reference positions, least squares, in closed form.

    Args:
        estimated: (n, 3) T_map_robot.
        reference: (n, 3) T_world_robot of the same scans.

    Returns:
        (3,) T_world_map. Headings take no part. Positions that never leave one point leave the rotation at 0.
    """
    mean_estimated, mean_reference = estimated[:, :2].mean(axis=0), reference[:, :2].mean(axis=0)
    a, b = estimated[:, :2] - mean_estimated, reference[:, :2] - mean_reference
    heading = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    translation = mean_reference - transform_points(np.array([0.0, 0.0, heading]), mean_estimated)
    return np.array([*translation, heading])


def trajectory_errors(estimated: NDArray[np.float64], reference: NDArray[np.float64]) -> TrajectoryErrors:
    """Align a trajectory with its reference and measure what is left.

    Args:
        estimated: (n, 3) T_map_robot.
        reference: (n, 3) T_world_robot of the same scans.

    Raises:
        EvaluationError: fewer than two poses.
    """
    if len(estimated) < 2:
        raise EvaluationError(f"found {len(estimated)} pose to compare, an alignment needs at least 2")
    error = compose(align(estimated, reference), estimated) - reference
    distances = np.hypot(error[:, 0], error[:, 1])
    return TrajectoryErrors(
        n=len(error),
        ate_rmse=float(np.sqrt((distances**2).mean())),
        ate_max=float(distances.max()),
        x_mean_abs=float(np.abs(error[:, 0]).mean()),
        y_mean_abs=float(np.abs(error[:, 1]).mean()),
        x_var=float(error[:, 0].var()),
        y_var=float(error[:, 1].var()),
        rot_rmse=float(np.sqrt((wrap_angle(error[:, 2]) ** 2).mean())),
    )
