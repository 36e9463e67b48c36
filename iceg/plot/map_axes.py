"""The map of a run on axes: walls, path, closures and landmarks as vectors, with scale bar and key."""

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.legend_handler import HandlerLineCollection
from matplotlib.lines import Line2D
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar
from numpy.typing import NDArray

from iceg.plot.axes_canvas import AxesCanvas
from iceg.show.canvas import Box
from iceg.show.drawn_run import drawn_run
from iceg.show.map_image import (
    CLOSURE_COLOUR,
    INK,
    KIND_COLOURS,
    KIND_LABELS,
    MapLayers,
    clock_time,
    known_box,
    paint_layers,
    time_colour,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist

    from iceg.maps.grid import OccupancyGrid
    from iceg.run_folder import RunFolder
    from iceg.run_result.slam_result import SlamResult

_UNKNOWN, _FREE, _WALL = "#e8e8e8", "#ffffff", "#141414"
_LANDMARKS = (("s", 5), ("o", 5), ("x", 4))
_SHADES = 24


def map(  # noqa: A001
    run: "SlamResult | RunFolder | MapLayers",
    ax: Axes,
    *,
    min_seen: int = 3,
    box: Box | None = None,
    line_width: float = 0.8,
    key: bool = True,
) -> None:
    """Draw a map: white is free, black is wall, grey is unknown; the path runs from yellow to blue.

    Walls are the outlines of the occupied cells, where the occupancy passes the thresholds of the grid.

    Args:
        run: a run, or what of it to show.
        ax: axes to draw on; aspect and limits are set, ticks removed.
        min_seen: landmarks seen less often are left out, as are those that have expired.
        box: x_min, x_max, y_min, y_max to show [m]; the known area when left out.
        line_width: of the path [points]; other strokes and markers follow it.
        key: whether to say below the map what is what.
    """
    layers = (run if isinstance(run, MapLayers) else drawn_run(run).layers()).settled(min_seen)
    box = box or known_box(layers.grid, layers.trajectory)
    _draw_grid(ax, layers, box)
    paint_layers(AxesCanvas(ax, line_width), layers)
    ax.set(xlim=box[:2], ylim=box[2:], xticks=[], yticks=[], aspect="equal")
    for spine in ax.spines.values():
        spine.set_visible(False)
    draw_scale_bar(ax, box[1] - box[0])
    if key:
        _draw_key(ax, layers)


def path_on_grid(
    grid: "OccupancyGrid", trajectory: NDArray[np.float64] | None, ax: Axes, *, box: Box | None = None
) -> None:
    """Draw an occupancy grid and a path on it, without a key.

    Args:
        grid: the grid.
        trajectory: (n, 3) T_map_robot, None to draw the grid alone.
        ax: axes to draw on.
        box: x_min, x_max, y_min, y_max to show [m]; the known area when left out.
    """
    map(MapLayers(grid=grid, trajectory=trajectory), ax, box=box, line_width=0.6, key=False)


def draw_scale_bar(ax: Axes, width: float) -> None:
    """Draw a bar of a round length, up to a sixth of what the axes show.

    Args:
        ax: axes in metres.
        width: of what they show [m].
    """
    wanted = max(width, 1e-3) / 6.0
    power = 10.0 ** math.floor(math.log10(wanted))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted)
    bar = AnchoredSizeBar(
        ax.transData,
        length,
        f"{length:g} m",
        "lower left",
        frameon=False,
        sep=2,
        size_vertical=0.004 * wanted,
        color=INK,
    )
    bar.set_zorder(4)
    ax.add_artist(bar)


def _draw_grid(ax: Axes, layers: MapLayers, box: Box) -> None:
    grid = layers.grid
    first_col, end_col = np.rint((np.array(box[:2]) - grid.origin[0]) / grid.resolution).astype(int)
    first_row, end_row = np.rint((np.array(box[2:]) - grid.origin[1]) / grid.resolution).astype(int)
    rows = slice(max(first_row, 0), max(end_row, 0))
    cols = slice(max(first_col, 0), max(end_col, 0))
    inside = grid.occupancy()[rows, cols]
    ax.set_facecolor(_UNKNOWN)
    if min(inside.shape) < 2:
        return
    x = grid.origin[0] + (cols.start + 0.5 + np.arange(inside.shape[1])) * grid.resolution
    y = grid.origin[1] + (rows.start + 0.5 + np.arange(inside.shape[0])) * grid.resolution
    for levels, colour in (((-1.0, grid.free_below), _FREE), ((grid.occupied_above, 2.0), _WALL)):
        if (inside < levels[1]).any() and (inside > levels[0]).any():
            ax.contourf(x, y, inside, levels=levels, colors=[colour], zorder=1, antialiased=True)


def _draw_key(ax: Axes, layers: MapLayers) -> None:
    symbols: list[tuple[Artist, str]] = []
    if layers.trajectory is not None:
        span = "start to end" if layers.seconds is None else f"0:00 to {clock_time(layers.seconds)}"
        symbols.append((LineCollection([], linewidths=2.5), f"path, {span}"))
    if layers.key_poses is not None:
        symbols.append((Line2D([], [], linestyle="none", marker=".", color=INK, markersize=3), "key pose"))
    if layers.closures is not None and len(layers.closures):
        line = Line2D([], [], color=CLOSURE_COLOUR, linewidth=1, marker="o", markersize=3)
        symbols.append((line, f"loop closure ({len(layers.closures)})"))
    if layers.landmarks is not None:
        counts = np.bincount(layers.landmarks.kinds, minlength=3)
        for (shape, size), colour, label, count in zip(_LANDMARKS, KIND_COLOURS, KIND_LABELS, counts, strict=True):
            if count:
                line = Line2D([], [], linestyle="none", marker=shape, color=colour, markersize=size)
                symbols.append((line, f"{label} ({count})"))
    if not symbols:
        return
    ax.legend(
        [symbol for symbol, _ in symbols],
        [text for _, text in symbols],
        handler_map={LineCollection: _PathHandler()},
        title=layers.title,
        title_fontsize="small",
        alignment="left",
        fontsize="x-small",
        frameon=False,
        ncols=3,
        loc="upper left",
        bbox_to_anchor=(0.0, 0.0),
        borderaxespad=0.2,
    )


class _PathHandler(HandlerLineCollection):
    """The path's symbol: a line in all its colours."""

    def create_artists(self, legend, orig_handle, xdescent, ydescent, width, height, fontsize, trans):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN202, ARG002
        x = np.linspace(-xdescent, width - xdescent, _SHADES + 1)
        middle = np.full(_SHADES, 0.5 * (height - ydescent))
        pieces = np.stack([np.column_stack([x[:-1], middle]), np.column_stack([x[1:], middle])], axis=1)
        colours = [time_colour(share) for share in np.linspace(0.0, 1.0, _SHADES)]
        return [LineCollection(list(pieces), colors=colours, linewidths=2.5, transform=trans)]
