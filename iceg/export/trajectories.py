"""Trajectories in the formats of other benchmarks: TUM, EuRoC and KITTI."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graph.elementary import cos_sin
from iceg.euroc import format_euroc
from iceg.export.options import ExportOptions
from iceg.export.text_file import write_text
from iceg.results import whole_results
from iceg.stamps import repaired_stamps
from iceg.tum import Trajectory, format_tum, read_tum


def write_tum(directory: Path, path: Path, options: ExportOptions) -> None:
    """Lines `t x y z qx qy qz qw`, one a scan in file order."""
    trajectory = _trajectory(directory, options)
    write_text(path, format_tum(trajectory.stamps, trajectory.poses))


def write_euroc(directory: Path, path: Path, options: ExportOptions) -> None:
    """A CSV of stamp [ns], position and quaternion, w first, one row a scan."""
    trajectory = _trajectory(directory, options)
    write_text(path, format_euroc(trajectory.stamps, trajectory.poses))


def write_kitti(directory: Path, path: Path, options: ExportOptions) -> None:
    """Twelve numbers a scan: the first three rows of its 4 × 4 pose, row by row; KITTI has no stamps."""
    write_text(path, format_kitti(_trajectory(directory, options).poses))


def format_kitti(poses: NDArray[np.float64]) -> str:
    """The text of a KITTI file, x ahead and z up as in the map: not turned into a camera's axes.

    Args:
        poses: (n, 3) T_map_robot.

    Returns:
        n lines; positions to a nanometre, rotations to 12 decimals.
    """
    cos, sin = cos_sin(poses[:, 2])
    table = np.column_stack([cos, -sin, poses[:, 0], sin, cos, poses[:, 1]]) + 0.0
    line = "%.12f %.12f 0 %.9f %.12f %.12f 0 %.9f 0 0 1 0\n"
    return (line * len(table)) % tuple(table.ravel().tolist())


def _trajectory(directory: Path, options: ExportOptions) -> Trajectory:
    with whole_results(directory):
        trajectory = read_tum(directory / "trajectory.tum")
    if options.stamps == "recorded":
        return trajectory
    return Trajectory(stamps=repaired_stamps(trajectory.stamps), poses=trajectory.poses)
