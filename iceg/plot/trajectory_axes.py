"""Where the robot went, seen from above and over time, and how far off that is where the truth is known."""

import itertools
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from graph.se2 import compose, wrap_angle
from iceg.evaluation.trajectory import align
from iceg.plot.time_axis import TimeAxis, tidy
from iceg.show.drawn_run import drawn_run
from iceg.show.map_image import INK, TIME_COLOURS
from iceg.tum import Trajectory

if TYPE_CHECKING:
    from iceg.run_folder import RunFolder
    from iceg.run_result.slam_result import SlamResult

_SIZE = (9.0, 4.6)
_TRUTH = "#9a9a9a"
_PIECES = 256
_TURNED = np.pi
_HEADING = "heading [°]"


def trajectory(run: "SlamResult | RunFolder", ax: Axes, *, truth: NDArray[np.float64] | None = None) -> None:
    """Draw the path from above, coloured by time.

    Args:
        run: the run.
        ax: axes to draw on.
        truth: (n, 3) true pose of each scan in any frame; the path is laid over it by least squares.
    """
    drawn = drawn_run(run)
    _draw_path(ax, Trajectory(stamps=drawn.stamps, poses=drawn.trajectory), drawn.name, truth)


def trajectory_figure(run: "SlamResult | RunFolder", *, truth: NDArray[np.float64] | None = None) -> Figure:
    """The path from above, and beside it over time: position and heading, or their errors where the truth is known.

    Args:
        run: the run.
        truth: (n, 3) true pose of each scan in any frame.

    Returns:
        A figure of a page's width, tied to no display.
    """
    drawn = drawn_run(run)
    return path_figure(Trajectory(stamps=drawn.stamps, poses=drawn.trajectory), drawn.name, truth=truth)


def path_figure(path: Trajectory, name: str, *, truth: NDArray[np.float64] | None = None) -> Figure:
    """As `trajectory_figure`, of a path alone.

    Args:
        path: stamped poses in file order.
        name: of the log.
        truth: (n, 3) true pose of each in any frame.
    """
    figure = Figure(figsize=_SIZE, layout="constrained")
    grid = figure.add_gridspec(3 if truth is None else 2, 2, width_ratios=(1.1, 1.0))
    _draw_path(figure.add_subplot(grid[:, 0]), path, name, truth)
    curves = _coordinates(path.poses) if truth is None else _errors(path.poses, truth)
    time = TimeAxis.of(path.stamps)
    panels: list[Axes] = []
    for row, (label, values) in enumerate(curves.items()):
        ax = figure.add_subplot(grid[row, 1], sharex=panels[0] if panels else None)
        ax.plot(time.of_scans, values, color=INK, linewidth=0.8)
        ax.set_ylabel(label)
        if label == _HEADING:
            ax.set(ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180))
        tidy(ax)
        ax.tick_params(labelbottom=False)
        panels.append(ax)
    panels[-1].tick_params(labelbottom=True)
    panels[-1].set_xlabel(time.label)
    figure.align_ylabels(panels)
    return figure


def _draw_path(ax: Axes, path: Trajectory, name: str, truth: NDArray[np.float64] | None) -> None:
    poses = path.poses
    if truth is not None:
        poses = compose(align(poses, truth), poses)
        ax.plot(*truth[:, :2].T, color=_TRUTH, linewidth=2.5, label="truth", zorder=1)
    time = TimeAxis.of(path.stamps)
    lines = _coloured(poses, time.of_scans)
    ax.add_collection(lines)
    ax.plot(*poses[:1, :2].T, "o", color=TIME_COLOURS[0], markeredgecolor="white", label="start", zorder=4)
    ax.plot(*poses[-1:, :2].T, "D", color=TIME_COLOURS[-1], markeredgecolor="white", label="end", zorder=4)
    ax.autoscale_view()
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.set_title(name, loc="left", fontsize="medium")
    ax.grid(alpha=0.3)
    ax.legend(
        fontsize="small",
        frameon=False,
        ncols=3,
        columnspacing=1.0,
        handletextpad=0.3,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.1,
    )
    if ax.figure is not None:
        ax.figure.colorbar(lines, ax=ax, label=time.label, orientation="horizontal", shrink=0.7, aspect=30)


def _coloured(poses: NDArray[np.float64], time: NDArray[np.float64]) -> LineCollection:
    """The path in pieces of one colour each, which join at their ends."""
    borders = np.unique(np.linspace(0, len(poses) - 1, _PIECES + 1).astype(int))
    pieces = [poses[first : last + 1, :2] for first, last in itertools.pairwise(borders)]
    colours = LinearSegmentedColormap.from_list("time", TIME_COLOURS)
    lines = LineCollection(pieces, cmap=colours, linewidths=1.2, capstyle="round", zorder=2)
    lines.set_array(time[borders[:-1]])
    lines.set_clim(float(time[0]), max(float(time[-1]), float(time[0]) + 1e-9))
    return lines


def _coordinates(poses: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Curves by label; the heading has a gap where it passes ±180°."""
    heading = wrap_angle(poses[:, 2])
    jumps = np.abs(np.diff(heading, append=heading[-1:])) > _TURNED
    return {
        "x [m]": poses[:, 0],
        "y [m]": poses[:, 1],
        _HEADING: np.degrees(np.where(jumps, np.nan, heading)),
    }


def _errors(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Curves by label: what is left after the path is laid over the truth."""
    error = compose(align(poses, truth), poses) - truth
    return {
        "position error [m]": np.hypot(error[:, 0], error[:, 1]),
        "heading error [°]": np.degrees(wrap_angle(error[:, 2])),
    }
