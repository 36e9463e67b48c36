"""A map as an image: the grid, and on it the trajectory, key poses, landmarks and loop closures."""

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from graph.elementary import cos_sin
from graph.limits import check_limit
from graph.short_repr import short_repr
from iceg.maps.grid import bands, occupancy_of
from iceg.show.canvas import Box, Canvas, MapCanvas

if TYPE_CHECKING:
    from iceg.maps.feature_map import Landmarks
    from iceg.maps.grid import OccupancyGrid

KIND_COLOURS = ("#c1272d", "#0072b2", "#7a7a7a")  # corner, end of wall, intersection
KIND_LABELS = ("corner", "end of wall", "intersection")
TIME_COLOURS = ("#f4a259", "#d1495b", "#8e3b8a", "#3b3b98")  # start to end, all readable on white
CLOSURE_COLOUR = "#00917c"
INK = "#222222"

_UNKNOWN, _FREE, _OCCUPIED = 232.0, 255.0, 20.0  # greys
_PIECES = 128
_STROKE = 0.25


@dataclass(frozen=True, kw_only=True)
class MapLayers:
    """What a picture of a map shows, from the ground up.

    Attributes:
        grid: the occupancy grid.
        trajectory: (n, 3) T_map_robot, painted as a line coloured by time.
        key_poses: (k, 3) T_map_key, painted as dots.
        landmarks: painted by kind, with short strokes along their walls.
        closures: (c, 2) pairs of rows of the trajectory joined by loop closures.
        name: of the log, for the key.
        seconds: that the trajectory took, for the key; None where that is not known.
    """

    grid: "OccupancyGrid"
    trajectory: NDArray[np.float64] | None = None
    key_poses: NDArray[np.float64] | None = None
    landmarks: "Landmarks | None" = None
    closures: NDArray[np.int64] | None = None
    name: str = ""
    seconds: float | None = None

    __repr__ = short_repr

    @property
    def title(self) -> str:
        """Name of the log, and the side of a cell."""
        metres = self.grid.resolution
        cells = f"cells of {100 * metres:g} cm" if metres < 1 else f"cells of {metres:g} m"
        return f"{self.name}, {cells}" if self.name else cells

    def settled(self, min_seen: int) -> "MapLayers":
        """Without landmarks that have expired or were seen less often than `min_seen` times."""
        if self.landmarks is None:
            return self
        return replace(self, landmarks=self.landmarks.settled(min_seen))


def map_image(layers: MapLayers, *, box: Box, long_side: int = 2000, line_width: float = 2.4) -> NDArray[np.uint8]:
    """Paint a map: white is free, black is occupied, light grey is unknown.

    Args:
        layers: what to paint.
        box: x_min, x_max, y_min, y_max to show [m], on cell borders.
        long_side: of the image [pixels], about: half to all of it where a cell gets a pixel or more, else up to twice.
        line_width: of the trajectory [pixels of an image of that size]; other strokes and markers follow it.

    Returns:
        (height, width, 3) red, green and blue, the y axis of the map upwards.
    """
    shades = scaled(_shades_in(layers.grid, box), long_side)[::-1]
    canvas = Canvas((shades.shape[0], shades.shape[1]), box, line_width * max(shades.shape) / long_side)
    paint_layers(canvas, layers)
    return canvas.over(shades)


def paint_layers(canvas: MapCanvas, layers: MapLayers) -> None:
    """Paint what lies on the grid: landmarks, the trajectory, key poses, and closures on top.

    Args:
        canvas: to paint on.
        layers: what to paint; the grid is there already.
    """
    trajectory = layers.trajectory
    if layers.landmarks is not None:
        _paint_landmarks(canvas, layers.landmarks)
    if trajectory is not None:
        _paint_trajectory(canvas, trajectory)
    if layers.key_poses is not None:
        canvas.dots(layers.key_poses[:, :2], INK, 1.1)
    if layers.closures is not None and trajectory is not None:
        ends = trajectory[layers.closures][:, :, :2]
        canvas.strokes(ends, CLOSURE_COLOUR, 0.5, opacity=0.7)
        canvas.dots(ends.reshape(-1, 2), CLOSURE_COLOUR, 1.6)
    if trajectory is not None and len(trajectory):
        canvas.marker(trajectory[0, :2], "o", TIME_COLOURS[0], 6.0, edge="white")
        canvas.marker(trajectory[-1, :2], "D", TIME_COLOURS[-1], 7.0, edge="white")


def known_box(grid: "OccupancyGrid", trajectory: NDArray[np.float64] | None = None, margin: float = 0.75) -> Box:
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


def time_colour(share: float) -> str:
    """Colour of a moment of the trajectory, the start being 0 and the end 1."""
    stops = np.array([ImageColor.getrgb(colour) for colour in TIME_COLOURS], dtype=np.float64)
    place = share * (len(stops) - 1)
    index = min(int(place), len(stops) - 2)
    mixed = stops[index] + (place - index) * (stops[index + 1] - stops[index])
    return "#" + "".join(f"{round(value):02x}" for value in mixed)


def clock_time(seconds: float) -> str:
    """Minutes and seconds, with hours where there are any: 4:05, 1:00:00."""
    minutes, left = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{left:02d}" if hours else f"{minutes}:{left:02d}"


def wall_strokes(positions: NDArray[np.float64], directions: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """One stroke from each position along each of its directions that is there.

    Args:
        positions: (n, 2) features or landmarks [m].
        directions: (n, 2) directions of their walls [rad], NaN for a missing one.
        length: of a stroke [m].

    Returns:
        (s, 2, 2) both ends of each stroke [m].
    """
    rows, walls = np.nonzero(np.isfinite(directions))
    angles = directions[rows, walls]
    ends = positions[rows] + length * np.stack(cos_sin(angles), axis=1)
    return np.stack([positions[rows], ends], axis=1)


def scaled(image: NDArray[np.uint8], long_side: int) -> NDArray[np.uint8]:
    """A whole number of pixels a cell, or of cells a pixel (the darkest counts, so that walls remain).

    Args:
        image: (height, width) greys of the cells.
        long_side: about as many pixels should the longer side get: as many whole ones a cell as fit, or up to twice as
            many where one a cell does not.

    Returns:
        Greys of the pixels.
    """
    cells = max(image.shape)
    if cells > 2 * long_side:
        factor = math.ceil(cells / (2 * long_side))
        rows, cols = (-(-n // factor) * factor for n in image.shape)
        padded = np.full((rows, cols), 255, dtype=np.uint8)
        padded[: image.shape[0], : image.shape[1]] = image
        blocks = padded.reshape(rows // factor, factor, cols // factor, factor)
        return np.asarray(blocks.min(axis=(1, 3)), dtype=np.uint8)
    factor = max(1, long_side // cells)
    return image.repeat(factor, axis=0).repeat(factor, axis=1)


def _shades(occupancy: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Greys of probabilities: unknown in between, fully white and black well before certainty."""
    shades = occupancy - np.float32(0.5)
    shades /= np.float32(0.35)
    np.clip(shades, -1.0, 1.0, out=shades)
    shades *= np.where(shades < 0, np.float32(_UNKNOWN - _FREE), np.float32(_OCCUPIED - _UNKNOWN))
    shades += np.float32(_UNKNOWN)
    return np.asarray(np.rint(shades, out=shades), dtype=np.uint8)


def _shades_in(grid: "OccupancyGrid", box: Box) -> NDArray[np.uint8]:
    """Greys of the cells in a box whose borders are cell borders; unknown where it leaves the grid."""
    first_col, end_col = np.rint((np.array(box[:2]) - grid.origin[0]) / grid.resolution).astype(int)
    first_row, end_row = np.rint((np.array(box[2:]) - grid.origin[1]) / grid.resolution).astype(int)
    n_cells = int(end_row - first_row) * int(end_col - first_col)
    check_limit(n_cells, "grid_cells", f"found a picture of {n_cells} cells to hold map and trajectory")
    shades = np.full((end_row - first_row, end_col - first_col), round(_UNKNOWN), dtype=np.uint8)
    n_rows, n_cols = grid.shape
    rows = slice(max(first_row, 0), max(min(end_row, n_rows), 0))
    cols = slice(max(first_col, 0), max(min(end_col, n_cols), 0))
    col = cols.start - first_col
    for band in bands(rows.stop - rows.start):
        log_odds = grid.log_odds[rows.start + band.start : rows.start + band.stop, cols]
        known = log_odds != 0.0
        row = rows.start - first_row + band.start
        inside = shades[row : row + len(log_odds), col : col + log_odds.shape[1]]
        inside[known] = _shades(occupancy_of(log_odds[known]))
    return shades


def _paint_trajectory(canvas: MapCanvas, trajectory: NDArray[np.float64]) -> None:
    """A line coloured by time: few pieces of one colour each, which join at their ends."""
    borders = np.unique(np.linspace(0, len(trajectory) - 1, _PIECES + 1).astype(int))
    shares = np.linspace(0.0, 1.0, max(len(borders) - 1, 1))
    for (first, last), share in zip(itertools.pairwise(borders), shares, strict=False):
        canvas.line(trajectory[first : last + 1, :2], time_colour(share), 1.0)


def _paint_landmarks(canvas: MapCanvas, landmarks: "Landmarks") -> None:
    """Intersections below, ends of walls, corners on top; strokes fine enough to leave the walls to be seen."""
    crossing, end, corner = (landmarks[landmarks.kinds == kind] for kind in (2, 1, 0))
    canvas.crosses(crossing.positions, KIND_COLOURS[2], 1.8, opacity=0.7)
    for chosen, colour in ((end, KIND_COLOURS[1]), (corner, KIND_COLOURS[0])):
        canvas.strokes(wall_strokes(chosen.positions, chosen.directions, _STROKE), colour, 0.5, opacity=0.8)
    canvas.dots(end.positions, KIND_COLOURS[1], 2.4)
    canvas.squares(corner.positions, KIND_COLOURS[0], 2.2)
