"""Pictures of a run: its map, where the robot went over time, and how sure the graph is of it."""

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graph.atomic import write_atomically
from graph.dense import eigvalsh
from graph.limits import LimitError
from graph.publish import publishing
from iceg.results import whole_results
from iceg.run_folder import RunFolder, is_of_dp_slam, read_ros_map, read_run_folder
from iceg.show.map_image import MapLayers
from iceg.show.map_picture import save_map_png
from iceg.slam.closures.closure import joined_scans
from iceg.tum import read_tum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = ("map.png", "trajectory.png", "uncertainty.png")

_DOTS_PER_INCH = 120


def plot_results(directory: Path | str) -> tuple[Path, ...]:
    """Draw all pictures of a run from the files in its folder.

    Args:
        directory: what a run has written, or DP-SLAM, which knows no uncertainty; all its pictures
            are replaced in one step.

    Returns:
        The pictures drawn.

    Raises:
        IcegError: a file is missing or not as expected.
    """
    directory = Path(directory)
    is_filter = is_of_dp_slam(directory)
    draw = _drawing_of_dp_slam(directory) if is_filter else _drawing_of_run(read_run_folder(directory))
    try:
        with publishing(directory) as staging:
            draw(*(staging / name for name in PICTURES))
    except LimitError as err:
        raise LimitError(f"{directory}: {err}") from err
    return tuple(directory / name for name in PICTURES[: 2 if is_filter else 3])


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
    along = np.sqrt(eigvalsh(covariances[:, :2, :2]).clip(min=0.0))
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


def _drawing_of_dp_slam(directory: Path) -> Callable[[Path, Path, Path], None]:
    with whole_results(directory):
        trajectory = read_tum(directory / "trajectory.tum").poses
        grid = read_ros_map(directory / "map.yaml")

    def draw(map_png: Path, trajectory_png: Path, _uncertainty_png: Path) -> None:
        save_map_png(map_png, MapLayers(grid=grid, trajectory=trajectory))
        save_trajectory_plot(trajectory, trajectory_png)

    return draw


def _drawing_of_run(run: RunFolder) -> Callable[[Path, Path, Path], None]:
    layers = MapLayers(
        grid=run.grid,
        trajectory=run.trajectory.poses,
        key_poses=run.key_poses,
        landmarks=run.landmarks,
        closures=joined_scans(run.closures),
    )

    def draw(map_png: Path, trajectory_png: Path, uncertainty_png: Path) -> None:
        save_map_png(map_png, layers)
        save_trajectory_plot(run.trajectory.poses, trajectory_png)
        save_uncertainty_plot(run.key_poses, run.covariances, uncertainty_png)

    return draw


def _save(figure: "Figure", path: Path) -> None:
    figure.align_ylabels()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DOTS_PER_INCH, metadata={"Software": None})
    write_atomically(path, buffer.getvalue())
