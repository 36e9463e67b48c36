"""The maps of two runs as two pictures of the same part of the world."""

import io
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from graph.elementary import cos_sin
from graph.limits import check_limit
from graph.se2 import compose, inverse, transform_points
from iceg.compare.closure_difference import LoneClosure
from iceg.compare.comparison import frame_of_b
from iceg.maps.grid import OccupancyGrid
from iceg.run_folder import RunFolder
from iceg.show.canvas import Box
from iceg.show.map_image import MapLayers, known_box, map_image

_LONG_SIDE = 1400
_ROWS = 256
"""Rows of a map that are laid on the other's cells at a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapPair:
    """Two pictures of one size.

    Attributes:
        a: PNG of run A's map …
        b: … and of run B's, in the frame of run A; each with its path, and with the closures that the other lacks.
        width: of both [pixels].
        height: of both [pixels].
        box: x_min, x_max, y_min, y_max that they show, frame of run A [m].
    """

    a: bytes
    b: bytes
    width: int
    height: int
    box: Box


def map_pair(a: RunFolder, b: RunFolder, lone: list[LoneClosure]) -> MapPair:
    """Draw both maps.

    Args:
        a: run A.
        b: run B.
        lone: closures that only one has.

    Raises:
        LimitError: both maps together are larger than a picture may be.
    """
    T_a_b = frame_of_b(a, b)
    of_b = compose(T_a_b, b.trajectory.poses)
    layers_a = MapLayers(grid=a.grid, trajectory=a.trajectory.poses, closures=_scans(lone, "A"))
    layers_b = MapLayers(grid=b.grid, trajectory=of_b, closures=_scans(lone, "B"))
    grid_b = _laid_on(a.grid, b.grid, T_a_b, of_b)
    layers_b = replace(layers_b, grid=grid_b)
    boxes = [known_box(layers.grid, layers.trajectory) for layers in (layers_a, layers_b)]
    box = (*_joined(boxes, 0), *_joined(boxes, 2))
    images = [map_image(layers, box=box, long_side=_LONG_SIDE) for layers in (layers_a, layers_b)]
    return MapPair(a=_png(images[0]), b=_png(images[1]), width=images[0].shape[1], height=images[0].shape[0], box=box)


def _scans(lone: list[LoneClosure], run: str) -> NDArray[np.int64]:
    pairs = [(closure.scan_i, closure.scan_j) for closure in lone if closure.only_in == run]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _joined(boxes: list[Box], axis: int) -> tuple[float, float]:
    return min(box[axis] for box in boxes), max(box[axis + 1] for box in boxes)


def _laid_on(
    a: OccupancyGrid, b: OccupancyGrid, T_a_b: NDArray[np.float64], path: NDArray[np.float64]
) -> OccupancyGrid:
    """Grid b on the cells of grid a, as far as b reaches: each has what lies at its centre."""
    x_min, x_max, y_min, y_max = b.extent
    corners = transform_points(T_a_b, np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]]))
    reach = np.concatenate([corners, path[:, :2]])
    low = np.floor((reach.min(axis=0) - a.origin) / a.resolution).astype(np.int64)
    n_cols, n_rows = (np.ceil((reach.max(axis=0) - a.origin) / a.resolution).astype(np.int64) - low).tolist()
    check_limit(n_rows * n_cols, "grid_cells", f"found a map of {n_rows} x {n_cols} cells to lay on another")
    origin = a.origin + low * a.resolution
    log_odds = np.zeros((n_rows, n_cols), np.float32)
    T_b_a, x = inverse(T_a_b), origin[0] + (np.arange(n_cols) + 0.5) * a.resolution
    cos, sin = cos_sin(T_b_a[2])
    for first in range(0, n_rows, _ROWS):
        y = (origin[1] + (np.arange(first, min(first + _ROWS, n_rows)) + 0.5) * a.resolution)[:, None]
        centres = np.stack([T_b_a[0] + cos * x - sin * y, T_b_a[1] + sin * x + cos * y], axis=-1)
        row, col = b.cell(centres)
        inside = (row >= 0) & (row < b.shape[0]) & (col >= 0) & (col < b.shape[1])
        log_odds[first : first + _ROWS][inside] = b.log_odds[row[inside], col[inside]]
    return replace(b, log_odds=log_odds, origin=origin, resolution=a.resolution)


def _png(image: NDArray[np.uint8]) -> bytes:
    content = io.BytesIO()
    Image.fromarray(image).save(content, format="PNG", compress_level=6)
    return content.getvalue()
