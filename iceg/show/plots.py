"""Pictures: the map as one would print it, and the parts notebooks put together.

Everything draws on axes it is given or on a figure of its own; no global state, no display needed.
"""

import io
import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backend_bases import GraphicsContextBase, RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Rectangle
from numpy.typing import ArrayLike, NDArray

from frontends.scan import Scan
from graph.atomic import write_atomically
from graph.se2 import transform_points

if TYPE_CHECKING:
    from iceg.ice.features import Features
    from iceg.maps.feature_map import Landmarks
    from iceg.maps.grid import OccupancyGrid

KIND_COLOURS = ("#c1272d", "#0072b2", "#7a7a7a")  # corner, end of wall, intersection
_KIND_MARKERS = ("s", "o", "x")
_KIND_LABELS = ("corner", "end of wall", "intersection")
_UNKNOWN, _FREE, _OCCUPIED = 232.0, 255.0, 20.0  # greys
_TIME_COLOURS = ("#f4a259", "#d1495b", "#8e3b8a", "#3b3b98")  # start to end, all readable on white
_CLOSURE_COLOUR = "#2a9d8f"
_INK = "#222222"
_DPI = 220
_STRIP = 0.42  # height below the map for the scale bar [inches]
_LEGEND_LINE = 0.16  # height of one more line, for a legend that does not fit beside it [inches]
_LEGEND_CHARACTER, _LEGEND_SYMBOL = 0.044, 0.28  # widths in the legend [inches]
_NARROWEST = 4.6  # sheet [inches]
_MARGIN = 0.15  # left and right of scale bar and legend [inches]


def draw_map(
    ax: Axes,
    grid: "OccupancyGrid",
    trajectory: NDArray[np.float64] | None = None,
    key_poses: NDArray[np.float64] | None = None,
    landmarks: "Landmarks | None" = None,
    closures: NDArray[np.int64] | None = None,
    *,
    min_seen: int = 3,
    box: tuple[float, float, float, float] | None = None,
    line_width: float = 0.8,
) -> None:
    """Draw a map: white is free, black is occupied, light grey is unknown.

    Args:
        ax: axes to draw on; aspect and limits are set, ticks removed.
        grid: the occupancy grid.
        trajectory: (n, 3) T_map_robot, drawn as a line coloured by time.
        key_poses: (k, 3) T_map_key, drawn as dots.
        landmarks: drawn by kind, with short strokes along their walls.
        closures: (c, 2) pairs of rows of the trajectory joined by loop closures.
        min_seen: landmarks seen less often are left out.
        box: x_min, x_max, y_min, y_max to show [m]; the known area when left out.
        line_width: of the trajectory [points]; other strokes and markers follow it.
    """
    box = box or known_box(grid, trajectory)
    ax.imshow(_shades_in(grid, box), cmap="gray", vmin=0, vmax=255, origin="lower", extent=box, interpolation="nearest")
    _draw_on_map(ax, box, trajectory, key_poses, landmarks, closures, min_seen, line_width)


def save_map_png(
    path: Path,
    grid: "OccupancyGrid",
    trajectory: NDArray[np.float64] | None = None,
    key_poses: NDArray[np.float64] | None = None,
    landmarks: "Landmarks | None" = None,
    closures: NDArray[np.int64] | None = None,
    *,
    min_seen: int = 3,
    long_side: int = 2000,
    title: str = "",
) -> None:
    """Save the picture of a map with its legend and scale bar; arguments as in `draw_map`.

    Args:
        path: the PNG file, written atomically.
        grid: the occupancy grid.
        trajectory: (n, 3) T_map_robot.
        key_poses: (k, 3) T_map_key.
        landmarks: the valid landmarks.
        closures: (c, 2) pairs of rows of the trajectory.
        min_seen: landmarks seen less often are left out.
        long_side: of the map, in pixels, about: a cell gets a whole number of pixels where there is room for one.
        title: a line beside the scale bar.
    """
    box = known_box(grid, trajectory)
    image = _scaled(_shades_in(grid, box), long_side)
    height_px, width_px = image.shape
    sheet_px = max(width_px, round(_NARROWEST * _DPI))
    inches_per_metre = width_px / _DPI / (box[1] - box[0])
    handles = _legend_handles(trajectory is not None, key_poses is not None, landmarks, closures, min_seen)
    columns, lines = _legend_layout(handles, sheet_px / _DPI, _scale_bar_end(inches_per_metre), title)
    strip = _STRIP + lines * _LEGEND_LINE
    strip_px = round(strip * _DPI)
    figure = Figure(figsize=(sheet_px / _DPI, (height_px + strip_px) / _DPI), dpi=_DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    left = (sheet_px - width_px) // 2
    figure.add_artist(_Pixels(image, left, strip_px))
    frame = (
        left / sheet_px,
        strip_px / (height_px + strip_px),
        width_px / sheet_px,
        height_px / (height_px + strip_px),
    )
    ax = figure.add_axes(frame, facecolor="none")
    _draw_on_map(ax, box, trajectory, key_poses, landmarks, closures, min_seen, 0.8)
    below = figure.add_axes((0.0, 0.0, 1.0, frame[1]))
    below.set(xlim=(0.0, sheet_px / _DPI), ylim=(_STRIP - strip, _STRIP))
    below.axis("off")
    _draw_scale_bar(below, inches_per_metre)
    if title:
        end = _scale_bar_end(inches_per_metre)
        below.text(end + 0.25, 0.5 * _STRIP, title, fontsize=7, color=_INK, va="center")
    _draw_legend(below, handles, columns, beside_scale_bar=lines == 0)
    write_atomically(path, _png(canvas))


class _Pixels(Artist):
    """A grey image painted pixel by pixel: quicker than matplotlib's own images, which resample."""

    def __init__(self, image: NDArray[np.uint8], left: int, bottom: int) -> None:
        super().__init__()
        self._corner = (left, bottom)
        self._rgba = np.full((*image.shape, 4), 255, dtype=np.uint8)
        self._rgba[:, :, :3] = image[:, :, None]
        self.set_zorder(-1)

    def draw(self, renderer: RendererBase) -> None:
        """Paint it."""
        context: GraphicsContextBase = renderer.new_gc()
        renderer.draw_image(context, *self._corner, self._rgba)
        context.restore()


def known_box(
    grid: "OccupancyGrid", trajectory: NDArray[np.float64] | None = None, margin: float = 0.75
) -> tuple[float, float, float, float]:
    """The part of a grid worth showing: walls and trajectory, without the few returns from far behind windows.

    Args:
        grid: the grid.
        trajectory: (n, 3) poses that must be inside.
        margin: added on all sides [m].

    Returns:
        x_min, x_max, y_min, y_max [m], on cell borders.
    """
    classes = grid.classes()
    marked = classes > 0
    if not marked.any():
        marked = classes == 0
    bounds = []
    for axis, origin in ((0, grid.origin[0]), (1, grid.origin[1])):
        mass = marked.sum(axis=axis).cumsum()
        low, high = np.searchsorted(mass, [0.002 * mass[-1], 0.998 * mass[-1]]) if mass[-1] else (0, len(mass) - 1)
        start, stop = origin + low * grid.resolution, origin + (high + 1) * grid.resolution
        if trajectory is not None and len(trajectory):
            start, stop = min(start, trajectory[:, axis].min()), max(stop, trajectory[:, axis].max())
        first = math.floor((start - margin - origin) / grid.resolution)
        last = math.ceil((stop + margin - origin) / grid.resolution)
        bounds += [float(origin + first * grid.resolution), float(origin + last * grid.resolution)]
    return bounds[0], bounds[1], bounds[2], bounds[3]


def draw_scan_features(ax: Axes, scan: Scan, features: "Features", *, stroke: float = 0.4) -> None:
    """Draw one scan with its features in the robot frame.

    Args:
        ax: axes to draw on.
        scan: the scan; its points become dots, its laser a triangle.
        features: its features; weak ones are drawn hollow and pale.
        stroke: length of the strokes along the walls of a feature [m].
    """
    points = scan.points
    ax.plot(*points.T, ".", color="#999999", markersize=2.5, zorder=1)
    ax.plot(*scan.geometry.origin_robot, marker=(3, 0, -90), color=_INK, markersize=8, zorder=2)
    for kind, (colour, marker, label) in enumerate(zip(KIND_COLOURS, _KIND_MARKERS, _KIND_LABELS, strict=True)):
        for real in (True, False):
            chosen = (features.kinds == kind) & (features.real == real)
            if not chosen.any():
                continue
            alpha = 1.0 if real else 0.4
            strokes = _wall_strokes(features.positions[chosen], features.directions[chosen], stroke)
            ax.add_collection(LineCollection(strokes, colors=colour, linewidths=1.2, alpha=alpha, zorder=3))
            ax.plot(
                *features.positions[chosen].T,
                marker,
                color=colour,
                markerfacecolor=colour if real and marker != "x" else "none",
                markersize=5,
                alpha=alpha,
                label=label if real else f"{label} (weak)",
                zorder=4,
            )
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.legend(fontsize="small", frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def draw_alignment(
    ax: Axes,
    reference_points: NDArray[np.float64],
    scan: Scan,
    T_ref_guess: NDArray[np.float64],
    T_ref_match: NDArray[np.float64],
) -> None:
    """Draw a scan on its reference, where it was expected and where it was matched.

    Args:
        ax: axes to draw on.
        reference_points: (n, 2) points of the reference [m].
        scan: the scan.
        T_ref_guess: (3,) where the robot was expected.
        T_ref_match: (3,) where the match put it.
    """
    ax.plot(*reference_points.T, ".", color="#999999", markersize=2.5, label="reference", zorder=1)
    poses = ((T_ref_guess, _TIME_COLOURS[0], "scan as expected"), (T_ref_match, "#0072b2", "scan as matched"))
    for zorder, (pose, colour, label) in enumerate(poses, start=2):
        ax.plot(*transform_points(pose, scan.points).T, ".", color=colour, markersize=4, label=label, zorder=zorder)
        nose = transform_points(pose, np.array([[0.0, 0.0], [0.5, 0.0]]))
        ax.plot(*nose.T, "-o", color=colour, markersize=7, markevery=[0], linewidth=2, zorder=4)
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.legend(fontsize="small", frameon=False)


def draw_covariance_ellipse(
    ax: Axes,
    mean: ArrayLike,
    covariance: ArrayLike,
    sigmas: float = 2.0,
    *,
    colour: str = "#c1272d",
    label: str | None = None,
) -> Ellipse:
    """Draw where a point lies with its covariance.

    Args:
        ax: axes to draw on.
        mean: (2,) or longer; x and y come first.
        covariance: (2, 2) or larger, the same order.
        sigmas: size of the ellipse in standard deviations.
        colour: of its line.
        label: for a legend.

    Returns:
        The ellipse.
    """
    centre = np.asarray(mean, dtype=np.float64)[:2]
    variances, axes = np.linalg.eigh(np.asarray(covariance, dtype=np.float64)[:2, :2])
    small, large = 2.0 * sigmas * np.sqrt(np.maximum(variances, 0.0))
    angle = math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
    ellipse = Ellipse(
        (float(centre[0]), float(centre[1])),
        float(large),
        float(small),
        angle=angle,
        fill=False,
        edgecolor=colour,
        linewidth=1.2,
        label=label,
        zorder=5,
    )
    ax.add_patch(ellipse)
    return ellipse


def draw_correlation_surface(
    ax: Axes,
    xs: NDArray[np.float64],
    ys: NDArray[np.float64],
    scores: NDArray[np.float64],
    best: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
) -> None:
    """Draw the correlation score over (dx, dy) around a match.

    Args:
        ax: axes to draw on.
        xs: (n_x,) shifts along x [m], evenly spaced.
        ys: (n_y,) shifts along y [m], evenly spaced.
        scores: (n_y, n_x) score of each shift.
        best: (2,) or longer, where the match came out [m].
        covariance: (2, 2) or larger, drawn as the ellipse of two standard deviations.
    """
    half_x, half_y = 0.5 * (xs[1] - xs[0]), 0.5 * (ys[1] - ys[0])
    extent = (float(xs[0] - half_x), float(xs[-1] + half_x), float(ys[0] - half_y), float(ys[-1] + half_y))
    image = ax.imshow(scores, origin="lower", extent=extent, cmap="magma", interpolation="nearest", aspect="equal")
    if best is not None:
        x, y = np.asarray(best, dtype=np.float64)[:2]
        ax.plot([x], [y], "+", color="#7fdbca", markersize=9, zorder=6)
        if covariance is not None:
            draw_covariance_ellipse(ax, best, covariance, 2.0, colour="#7fdbca")
    ax.set(xlabel="x [m]", ylabel="y [m]")
    if ax.figure is not None:
        ax.figure.colorbar(image, ax=ax, label="correlation score")


def draw_error_over_time(
    ax: Axes,
    stamps: NDArray[np.float64],
    errors: NDArray[np.float64],
    sigmas: NDArray[np.float64] | None = None,
    *,
    label: str = "position error [m]",
    bound: float = 3.0,
) -> None:
    """Draw an error along the trajectory against the uncertainty that was claimed for it.

    Args:
        ax: axes to draw on.
        stamps: (n,) time or path length of each pose.
        errors: (n,) signed or absolute error.
        sigmas: (n,) claimed standard deviation; the band of ± `bound` of them is shaded.
        label: of the vertical axis.
        bound: size of the band in standard deviations.
    """
    if sigmas is not None:
        low = -bound * sigmas if (errors < 0).any() else np.zeros_like(sigmas)
        ax.fill_between(
            stamps, low, bound * sigmas, color="#0072b2", alpha=0.15, linewidth=0, label=f"{bound:g} σ claimed"
        )
    ax.plot(stamps, errors, color=_INK, linewidth=1.0, label="error")
    ax.set(xlabel="time [s]", ylabel=label)
    ax.margins(x=0)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    ax.legend(fontsize="small", frameon=False)


def _shades(occupancy: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Greys of probabilities: unknown in between, fully white and black well before certainty."""
    certainty = np.clip((occupancy - 0.5) / 0.35, -1.0, 1.0)
    shades = _UNKNOWN + np.where(certainty < 0, (_UNKNOWN - _FREE) * certainty, (_OCCUPIED - _UNKNOWN) * certainty)
    return np.asarray(np.round(shades), dtype=np.uint8)


def _shades_in(grid: "OccupancyGrid", box: tuple[float, float, float, float]) -> NDArray[np.uint8]:
    """Greys of the cells in a box whose borders are cell borders; unknown where it leaves the grid."""
    first_col, end_col = np.rint((np.array(box[:2]) - grid.origin[0]) / grid.resolution).astype(int)
    first_row, end_row = np.rint((np.array(box[2:]) - grid.origin[1]) / grid.resolution).astype(int)
    shades = np.full((end_row - first_row, end_col - first_col), round(_UNKNOWN), dtype=np.uint8)
    n_rows, n_cols = grid.shape
    rows = slice(max(first_row, 0), max(min(end_row, n_rows), 0))
    cols = slice(max(first_col, 0), max(min(end_col, n_cols), 0))
    inside = _shades(grid.occupancy()[rows, cols])
    row, col = rows.start - first_row, cols.start - first_col
    shades[row : row + inside.shape[0], col : col + inside.shape[1]] = inside
    return shades


def _scaled(image: NDArray[np.uint8], long_side: int) -> NDArray[np.uint8]:
    """A whole number of pixels a cell, or of cells a pixel (the darkest counts, so that walls remain)."""
    cells = max(image.shape)
    if cells > 2 * long_side:
        factor = math.ceil(cells / (2 * long_side))
        rows, cols = (-(-n // factor) * factor for n in image.shape)
        padded = np.full((rows, cols), 255, dtype=np.uint8)
        padded[: image.shape[0], : image.shape[1]] = image
        blocks = padded.reshape(rows // factor, factor, cols // factor, factor)
        return np.asarray(blocks.min(axis=(1, 3)), dtype=np.uint8)
    factor = max(1, round(long_side / cells))
    return image.repeat(factor, axis=0).repeat(factor, axis=1)


def _png(canvas: FigureCanvasAgg) -> bytes:
    """The picture as PNG without transparency, quickly compressed."""
    from PIL import Image

    draw: Callable[[], None] = canvas.draw
    draw()
    pixels: Callable[[], memoryview] = canvas.buffer_rgba
    content = io.BytesIO()
    image = Image.fromarray(np.ascontiguousarray(np.asarray(pixels())[:, :, :3]))
    image.save(content, format="PNG", compress_level=2, dpi=(_DPI, _DPI))
    return content.getvalue()


def _draw_on_map(
    ax: Axes,
    box: tuple[float, float, float, float],
    trajectory: NDArray[np.float64] | None,
    key_poses: NDArray[np.float64] | None,
    landmarks: "Landmarks | None",
    closures: NDArray[np.int64] | None,
    min_seen: int,
    line_width: float,
) -> None:
    """All that lies on the grid, on axes without decoration."""
    if landmarks is not None:
        _draw_landmarks(ax, landmarks[landmarks.seen >= min_seen], line_width)
    if closures is not None and trajectory is not None and len(closures):
        ends = trajectory[closures][:, :, :2]
        ax.add_collection(
            LineCollection(list(ends), colors=_CLOSURE_COLOUR, linewidths=0.4 * line_width, alpha=0.45, zorder=4)
        )
    if trajectory is not None:
        _draw_trajectory(ax, trajectory, line_width)
    if key_poses is not None:
        size = 2.4 * line_width
        ax.plot(*key_poses[:, :2].T, ".", color=_INK, markersize=size, markeredgewidth=0, alpha=0.8, zorder=6)
    ax.set(xlim=box[:2], ylim=box[2:], xticks=[], yticks=[], aspect="equal")
    for spine in ax.spines.values():
        spine.set_visible(False)


def _time_colours() -> LinearSegmentedColormap:
    return LinearSegmentedColormap.from_list("time", _TIME_COLOURS)


def _draw_trajectory(ax: Axes, trajectory: NDArray[np.float64], line_width: float, pieces: int = 128) -> None:
    """A line coloured by time: few pieces of one colour each, which join at their ends."""
    borders = np.unique(np.linspace(0, len(trajectory) - 1, pieces + 1).astype(int))
    if len(borders) < 2:
        ax.plot(*trajectory[:, :2].T, "o", color=_TIME_COLOURS[0], markersize=3, zorder=7)
        return
    lines = [trajectory[a : b + 1, :2] for a, b in itertools.pairwise(borders)]
    colours = _time_colours()(np.linspace(0.0, 1.0, len(lines)))
    ax.add_collection(LineCollection(lines, colors=colours, linewidths=line_width, capstyle="round", zorder=5))
    size = 5.0 * line_width
    for pose, colour, marker in ((trajectory[0], _TIME_COLOURS[0], "o"), (trajectory[-1], _TIME_COLOURS[-1], "D")):
        ax.plot([pose[0]], [pose[1]], marker, color=colour, markersize=size, markeredgecolor="white", mew=0.5, zorder=8)


def _draw_landmarks(ax: Axes, landmarks: "Landmarks", line_width: float) -> None:
    for kind, (colour, marker) in reversed(list(enumerate(zip(KIND_COLOURS, _KIND_MARKERS, strict=True)))):
        chosen = landmarks.kinds == kind
        if not chosen.any():
            continue
        oriented = marker != "x"
        if oriented:
            strokes = _wall_strokes(landmarks.positions[chosen], landmarks.directions[chosen], 0.25)
            ax.add_collection(LineCollection(strokes, colors=colour, linewidths=line_width, zorder=3))
        ax.plot(
            *landmarks.positions[chosen].T,
            marker,
            color=colour,
            markersize=(2.2 if oriented else 1.2) * line_width,
            markeredgewidth=0.0 if oriented else 0.3 * line_width,
            alpha=1.0 if oriented else 0.35,
            zorder=4 if oriented else 2,
        )


def _wall_strokes(
    positions: NDArray[np.float64], directions: NDArray[np.float64], length: float
) -> list[NDArray[np.float64]]:
    """One stroke from each position along each of its directions that is there."""
    rows, walls = np.nonzero(np.isfinite(directions))
    angles = directions[rows, walls]
    ends = positions[rows] + length * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return list(np.stack([positions[rows], ends], axis=1))


def _scale_bar_length(inches_per_metre: float) -> float:
    """A round length that takes about an inch [m]."""
    lengths = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
    return min(lengths, key=lambda metres: abs(math.log(metres * inches_per_metre / 1.0)))


def _scale_bar_end(inches_per_metre: float) -> float:
    """Where the bar and its label end, seen from the left edge of the sheet [inches]."""
    return _MARGIN + _scale_bar_length(inches_per_metre) * inches_per_metre + 0.15


def _draw_scale_bar(ax: Axes, inches_per_metre: float) -> None:
    length = _scale_bar_length(inches_per_metre)
    x, y, height = _MARGIN, 0.3 * _STRIP, 0.045
    for part in range(4):
        colour = _INK if part % 2 == 0 else "white"
        quarter = length * inches_per_metre / 4
        ax.add_patch(Rectangle((x + part * quarter, y), quarter, height, fc=colour, ec=_INK, lw=0.5))
    ax.text(x, y + 0.1, "0", fontsize=6, color=_INK, ha="center", va="bottom")
    ax.text(x + length * inches_per_metre, y + 0.1, f"{length:g} m", fontsize=6, color=_INK, ha="center", va="bottom")


def _legend_handles(
    has_trajectory: bool,
    has_key_poses: bool,
    landmarks: "Landmarks | None",
    closures: NDArray[np.int64] | None,
    min_seen: int,
) -> list[Line2D]:
    handles: list[Line2D] = []
    if has_trajectory:
        handles.append(Line2D([], [], marker="o", color=_TIME_COLOURS[0], markersize=4, lw=1.2, label="start"))
        handles.append(Line2D([], [], marker="D", color=_TIME_COLOURS[-1], markersize=4, lw=1.2, label="end"))
    if has_key_poses:
        handles.append(Line2D([], [], marker=".", color=_INK, markersize=3, lw=0, label="key pose"))
    if closures is not None and len(closures):
        handles.append(Line2D([], [], color=_CLOSURE_COLOUR, lw=0.8, label=f"loop closure ({len(closures)})"))
    if landmarks is not None:
        counts = np.bincount(landmarks.kinds[landmarks.seen >= min_seen], minlength=3)
        for colour, marker, label, count in zip(KIND_COLOURS, _KIND_MARKERS, _KIND_LABELS, counts, strict=True):
            if count:
                size = 3.5 if marker != "x" else 2.5
                handles.append(
                    Line2D([], [], marker=marker, color=colour, markersize=size, lw=0, label=f"{label} ({count})")
                )
    return handles


def _legend_layout(handles: list[Line2D], sheet: float, scale_bar_end: float, title: str) -> tuple[int, int]:
    """Columns of the legend, and the lines it needs below the scale bar: none where it fits beside it."""
    widths = [_LEGEND_SYMBOL + _LEGEND_CHARACTER * len(str(handle.get_label())) for handle in handles]
    taken = scale_bar_end + (0.25 + 0.06 * len(title) if title else 0.0)
    if taken + sum(widths) + _MARGIN <= sheet:
        return max(1, len(handles)), 0
    columns = max(1, int((sheet - 2 * _MARGIN) / max(widths)))
    return columns, math.ceil(len(handles) / columns)


def _draw_legend(ax: Axes, handles: list[Line2D], columns: int, *, beside_scale_bar: bool) -> None:
    if not handles:
        return
    left, right = ax.get_xlim()
    low, high = ax.get_ylim()
    middle = (0.5 * _STRIP - low) / (high - low)
    ax.legend(
        handles=handles,
        loc="center right" if beside_scale_bar else "lower left",
        bbox_to_anchor=((right - 0.1) / right, middle)
        if beside_scale_bar
        else ((left + 0.1) / right, 0.06 / (high - low)),
        ncols=columns,
        fontsize=6,
        frameon=False,
        handletextpad=0.4,
        columnspacing=1.2,
        borderaxespad=0.0,
        borderpad=0.0,
        labelspacing=0.35,
    )
