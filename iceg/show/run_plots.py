"""Pictures of a run: its map, where the robot went over time, and how sure the graph is of it."""

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graph.atomic import write_atomically
from iceg.maps.feature_map import Landmarks
from iceg.maps.grid import OccupancyGrid
from iceg.run_folder import read_run_folder
from iceg.slam.closure import Closure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = ("map.png", "trajectory.png", "uncertainty.png")

_DOTS_PER_INCH = 120


def plot_results(directory: Path) -> tuple[Path, ...]:
    """Draw all pictures of a run from the files in its folder.

    Args:
        directory: what a run has written; `map.png` in it is replaced.

    Returns:
        The pictures drawn.

    Raises:
        IcegError: a file is missing or not as expected.
    """
    run = read_run_folder(directory)
    map_png, trajectory_png, uncertainty_png = (directory / name for name in PICTURES)
    save_map_picture(
        map_png,
        grid=run.grid,
        trajectory=run.trajectory.poses,
        key_poses=run.key_poses,
        landmarks=run.landmarks,
        closures=run.closures,
    )
    save_trajectory_plot(run.trajectory.poses, trajectory_png)
    save_uncertainty_plot(run.key_poses, run.covariances, uncertainty_png)
    return map_png, trajectory_png, uncertainty_png


def save_map_picture(
    path: Path,
    *,
    grid: OccupancyGrid,
    trajectory: NDArray[np.float64],
    key_poses: NDArray[np.float64],
    landmarks: Landmarks,
    closures: Sequence[Closure],
) -> None:
    """Draw grid, trajectory, key poses, valid landmarks and accepted loop closures.

    Args:
        path: the PNG to write.
        grid: the occupancy grid.
        trajectory: (n, 3) T_map_robot of every scan.
        key_poses: (k, 3) T_map_robot.
        landmarks: all of them; expired ones are left out.
        closures: all that were tried.
    """
    from iceg.show.map_picture import save_map_png

    accepted = [(closure.scan_i, closure.scan_j) for closure in closures if closure.verdict == "accepted"]
    save_map_png(
        path,
        grid,
        trajectory,
        key_poses,
        landmarks[landmarks.expired_at < 0],
        np.array(accepted, dtype=np.int64).reshape(-1, 2),
    )


def save_trajectory_plot(poses: NDArray[np.float64], path: Path) -> None:
    """Draw x, y and heading of every scan.

    Args:
        poses: (n, 3) T_map_robot.
        path: the PNG to write.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    headings = np.degrees(np.unwrap(poses[:, 2]))
    for axis, values, label in zip(axes, [*poses[:, :2].T, headings], ["x [m]", "y [m]", "heading [°]"], strict=True):
        axis.plot(values, linewidth=0.8)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("scan")
    _save(figure, path)


def save_uncertainty_plot(key_poses: NDArray[np.float64], covariances: NDArray[np.float64], path: Path) -> None:
    """Draw the standard deviations of the key poses along the way.

    Args:
        key_poses: (k, 3) T_map_robot.
        covariances: (k, 3, 3) in the tangent space at each.
        path: the PNG to write.
    """
    from matplotlib.figure import Figure

    steps = np.hypot(*np.diff(key_poses[:, :2], axis=0).T)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    along = np.sqrt(np.linalg.eigvalsh(covariances[:, :2, :2]).clip(min=0.0))
    figure = Figure(figsize=(9, 5), layout="constrained")
    position, heading = figure.subplots(2, 1, sharex=True)
    position.plot(travelled, along[:, 1], label="widest direction")
    position.plot(travelled, along[:, 0], label="narrowest direction")
    position.set_ylabel("position, 1σ [m]")
    position.legend()
    heading.plot(travelled, np.sqrt(covariances[:, 2, 2].clip(min=0.0)) * 180.0 / math.pi)
    heading.set_ylabel("heading, 1σ [°]")
    heading.set_xlabel("path length [m]")
    for axis in (position, heading):
        axis.set_ylim(bottom=0.0)
        axis.grid(alpha=0.3)
    _save(figure, path)


def _save(figure: "Figure", path: Path) -> None:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DOTS_PER_INCH, metadata={"Software": None})
    write_atomically(path, buffer.getvalue())
