"""Pictures of a run as files: its map, where the robot went, how sure the graph is of it, and its closures."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from graph.atomic import write_atomically
from graph.limits import LimitError
from graph.publish import publishing
from iceg.results import ResultsError, whole_results
from iceg.run_folder import RunFolder, is_of_dp_slam, log_name, read_ros_map, read_run_folder
from iceg.show.drawn_run import drawn_run, duration
from iceg.show.map_image import MapLayers, known_box
from iceg.show.map_picture import save_map_png
from iceg.tum import read_tum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PictureName = Literal["map", "trajectory", "uncertainty", "closures"]
PictureFormat = Literal["png", "svg", "pdf"]

PICTURES: tuple[PictureName, ...] = ("map", "trajectory", "uncertainty")
"""What is drawn unless asked otherwise."""

_DOTS_PER_INCH = 120
_MAP_SIDE, _KEY_HEIGHT = 8.0, 0.9  # inches


def plot_results(
    directory: Path | str,
    what: Sequence[PictureName] | None = None,
    picture_format: PictureFormat = "png",
    truth: NDArray[np.float64] | None = None,
) -> tuple[Path, ...]:
    """Draw pictures of a run from the files in its folder; svg and pdf hold every wall and stroke as a vector.

    Args:
        directory: what a run has written, or DP-SLAM, which knows no uncertainty; the pictures there are replaced in
            one step.
        what: which pictures; all that a run has, `PICTURES`, when left out.
        picture_format: of the files.
        truth: (n, 3) true pose of each scan: the trajectory is drawn with its errors.

    Returns:
        The pictures drawn.

    Raises:
        IcegError: a file is missing or not as expected, or the run does not have what is asked for.
    """
    directory = Path(directory)
    drawings = _of_filter(directory) if is_of_dp_slam(directory) else _of_run(read_run_folder(directory), truth)
    chosen = [name for name in PICTURES if name in drawings] if what is None else list(dict.fromkeys(what))
    lacking = next((name for name in chosen if name not in drawings), None)
    if lacking is not None:
        raise ResultsError(f"{directory}: holds nothing to draw '{lacking}' from, expected {', '.join(drawings)}")
    try:
        with publishing(directory) as staging:
            for name in chosen:
                drawings[name].save(staging / f"{name}.{picture_format}")
    except LimitError as err:
        raise LimitError(f"{directory}: {err}") from err
    return tuple(directory / f"{name}.{picture_format}" for name in chosen)


@dataclass(frozen=True)
class _Drawing:
    """How one picture is drawn: as a figure, and as PNG perhaps without the plotting library, which takes time."""

    figure: Callable[[], "Figure"]
    save_png: Callable[[Path], None] | None = None

    def save(self, path: Path) -> None:
        """Write the picture in the format that its name ends in."""
        if path.suffix == ".png" and self.save_png is not None:
            self.save_png(path)
        else:
            save_figure(self.figure(), path)


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure: the same bytes whenever it is written.

    Args:
        figure: what to write.
        path: of the picture, ending in png, svg or pdf.
    """
    import matplotlib as mpl

    kind = path.suffix[1:]
    dateless = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "iceg"}):
        figure.savefig(buffer, format=kind, dpi=_DOTS_PER_INCH, metadata=dateless)
    write_atomically(path, buffer.getvalue())


def map_figure(layers: MapLayers) -> "Figure":
    """The map with its key, tied to no display.

    Args:
        layers: what to show.
    """
    from matplotlib.figure import Figure

    from iceg import plot

    x_min, x_max, y_min, y_max = known_box(layers.grid, layers.trajectory)
    scale = _MAP_SIDE / max(x_max - x_min, y_max - y_min)
    width, height = max(5.0, scale * (x_max - x_min)), scale * (y_max - y_min) + _KEY_HEIGHT
    figure = Figure(figsize=(width, height), layout="constrained")
    plot.map(layers, figure.subplots())
    return figure


def _of_run(run: RunFolder, truth: NDArray[np.float64] | None) -> dict[PictureName, _Drawing]:
    layers = drawn_run(run).layers()

    def trajectory() -> "Figure":
        from iceg import plot

        return plot.trajectory_figure(run, truth=truth)

    def uncertainty() -> "Figure":
        from iceg import plot

        return plot.uncertainty_figure(run)

    def closures() -> "Figure":
        from matplotlib.figure import Figure

        from iceg import plot

        figure = Figure(figsize=(5.0, 5.0), layout="constrained")
        plot.closures(run, figure.subplots())
        return figure

    return {
        "map": _map(layers),
        "trajectory": _Drawing(trajectory),
        "uncertainty": _Drawing(uncertainty),
        "closures": _Drawing(closures),
    }


def _of_filter(directory: Path) -> dict[PictureName, _Drawing]:
    with whole_results(directory):
        path, grid = read_tum(directory / "trajectory.tum"), read_ros_map(directory / "map.yaml")
    name = log_name(directory)

    def trajectory() -> "Figure":
        from iceg.plot.trajectory_axes import path_figure

        return path_figure(path, name)

    return {
        "map": _map(MapLayers(grid=grid, trajectory=path.poses, name=name, seconds=duration(path.stamps))),
        "trajectory": _Drawing(trajectory),
    }


def _map(layers: MapLayers) -> _Drawing:
    return _Drawing(partial(map_figure, layers), partial(save_map_png, layers=layers))
