"""Occupancy grid: rendered from the trajectory and the scans, written as ROS map_server reads it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.scan import ScanGeometry
from graph.atomic import replacing, write_atomically
from graph.elementary import cos_sin, exp
from graph.short_repr import short_repr
from iceg.maps import _grid_kernels as kernels
from iceg.maps.config import GridConfig, GridError, GridSizeError

FREE, OCCUPIED, UNKNOWN = 0, 100, -1  # the values of a ROS OccupancyGrid message

OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196  # map_server's defaults, written into map.yaml
_BAND = 256  # rows
_GREY = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}  # map_server reads 1 - grey/255 against the two thresholds


@dataclass(frozen=True, slots=True, kw_only=True)
class OccupancyGrid:
    """What is known of each cell.

    Attributes:
        log_odds: (n_rows, n_cols) float32; row 0 is the lowest y, column 0 the lowest x; 0 where nothing is known.
        origin: (2,) x, y of the lower left corner of cell (0, 0) in the map frame [m].
        resolution: side of a cell [m].
        occupied_above: a cell counts as occupied above this probability.
        free_below: a cell counts as free below this probability.
    """

    log_odds: NDArray[np.float32]
    origin: NDArray[np.float64]
    resolution: float
    occupied_above: float = 0.6
    free_below: float = 0.45

    __repr__ = short_repr

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.log_odds.shape[0], self.log_odds.shape[1]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max in the map frame [m], as matplotlib's imshow takes it with origin="lower"."""
        rows, cols = self.shape
        x, y = float(self.origin[0]), float(self.origin[1])
        return x, x + cols * self.resolution, y, y + rows * self.resolution

    def occupancy(self) -> NDArray[np.float32]:
        """(n_rows, n_cols) probability of each cell being occupied; 0.5 where nothing is known."""
        return occupancy_of(self.log_odds)

    def classes(self) -> NDArray[np.int8]:
        """(n_rows, n_cols) of FREE (0), OCCUPIED (100) and UNKNOWN (-1), the values of a ROS OccupancyGrid."""
        classes = np.full(self.shape, UNKNOWN, dtype=np.int8)
        classes[self.log_odds < _log_odds(self.free_below)] = FREE
        classes[self.log_odds > _log_odds(self.occupied_above)] = OCCUPIED
        return classes

    def cell(self, p_map: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of points.

        Args:
            p_map: (..., 2) points in the map frame [m].

        Returns:
            Row and column indices, (...) each; they may lie outside the grid.
        """
        col_row = np.floor((p_map - self.origin) / self.resolution).astype(np.int64)
        return col_row[..., 1], col_row[..., 0]


def render_grid(
    trajectory: NDArray[np.float64],
    ranges: NDArray[np.float32],
    geometry: ScanGeometry,
    config: GridConfig | None = None,
) -> OccupancyGrid:
    """Render the occupancy grid of scans taken along a trajectory.

    A beam is a cone: it ends on the surface its neighbours and it agree on, the cells there share the evidence of its
    return, and the cells whose centre its cone covers before it are free. Each cell changes at most once a scan, and a
    cell hit in a scan is not missed by it. A full rendering of a large log takes a fraction of a second, less than the
    bookkeeping that would tell which cells a moved pose has touched: after a change of the trajectory render again.

    Args:
        trajectory: (n, 3) T_map_robot of each scan.
        ranges: (n, n_beams) [m], NaN without return.
        geometry: the laser.
        config: settings; the defaults when left out.

    Returns:
        The grid, just large enough for all that was seen.

    Raises:
        GridSizeError: for a grid beyond `max_cells`.
        GridError: for arrays that do not belong together, or poses that are not finite.
    """
    config = config or GridConfig()
    trajectory, ranges = _checked(trajectory, ranges, geometry)
    used = _spaced_scans(trajectory, config.min_travel, config.min_turn)
    T_map_laser = _laser_poses(trajectory[used], geometry)
    ranges = ranges[used]
    half_widths, touching = _half_widths(geometry, config.beam_width)
    cone = _cone(config, touching=touching)
    bearings = np.ascontiguousarray(geometry.bearings, dtype=np.float64)
    box = kernels.extent(T_map_laser, ranges, bearings, half_widths, config.max_range, config.no_return_range)
    origin, shape = _frame(box, config)
    log_odds = np.zeros(shape, dtype=np.float32)
    kernels.render(
        log_odds,
        float(origin[0]),
        float(origin[1]),
        config.resolution,
        T_map_laser,
        ranges,
        bearings,
        half_widths,
        cone,
        _evidence(config),
    )
    return OccupancyGrid(
        log_odds=log_odds,
        origin=origin,
        resolution=config.resolution,
        occupied_above=config.occupied_above,
        free_below=config.free_below,
    )


def render_grid_that_fits(
    trajectory: NDArray[np.float64],
    ranges: NDArray[np.float32],
    geometry: ScanGeometry,
    config: GridConfig | None = None,
) -> tuple[OccupancyGrid, str | None]:
    """As `render_grid`, but with cells twice as wide, and again, where the grid would exceed `max_cells`.

    Args:
        trajectory: (n, 3) T_map_robot of each scan.
        ranges: (n, n_beams) [m].
        geometry: of the laser.
        config: cells and evidence.

    Returns:
        The grid, and a sentence that says so when its cells are wider than asked for.

    Raises:
        GridError: as `render_grid`.
    """
    asked = fitting = config or GridConfig()
    refusal = None
    while True:
        try:
            grid = render_grid(trajectory, ranges, geometry, fitting)
        except GridSizeError as err:
            refusal = refusal or err
            fitting = replace(fitting, resolution=2.0 * fitting.resolution)
            continue
        if refusal is None:
            return grid, None
        return grid, (
            f"the cells of the grid are {grid.resolution:g} m wide instead of {asked.resolution:g} m: {refusal} "
            "If so, a larger grid.max_cells keeps the resolution."
        )


def write_ros_map(grid: OccupancyGrid, directory: Path, stem: str = "map") -> tuple[Path, Path]:
    """Write a grid as ROS map_server reads it: `<stem>.pgm` and `<stem>.yaml`.

    Args:
        grid: the grid.
        directory: an existing folder.
        stem: name of both files without their endings.

    Returns:
        Paths of the image and of its description.
    """
    pgm, yaml = directory / f"{stem}.pgm", directory / f"{stem}.yaml"
    with replacing(pgm) as stream:
        stream.write(_pgm(grid))
    description = (
        f"image: {pgm.name}\n"
        "mode: trinary\n"
        f"resolution: {grid.resolution:.9g}\n"
        f"origin: [{grid.origin[0]:.9g}, {grid.origin[1]:.9g}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESHOLD}\n"
        f"free_thresh: {FREE_THRESHOLD}\n"
    )
    write_atomically(yaml, description.encode("ascii"))
    return pgm, yaml


def occupancy_of(log_odds: NDArray[np.float32]) -> NDArray[np.float32]:
    """(...) probability of being occupied."""
    return (1.0 / (1.0 + exp(-log_odds))).astype(np.float32)


def bands(n_rows: int) -> Iterator[slice]:
    """The rows of a grid, few enough at a time that what is made of them takes little memory beside the grid."""
    for start in range(0, n_rows, _BAND):
        yield slice(start, min(start + _BAND, n_rows))


def _pgm(grid: OccupancyGrid) -> bytearray:
    """The grid as an image of 8 bits."""
    rows, cols = grid.shape
    header = f"P5\n# resolution {grid.resolution:.6g} m, lower left corner in map.yaml\n{cols} {rows}\n255\n"
    content = bytearray(len(header) + rows * cols)
    content[: len(header)] = header.encode("ascii")
    # An image's first row is its top, the grid's first row its bottom.
    image = np.frombuffer(content, dtype=np.uint8, offset=len(header)).reshape(rows, cols)[::-1]
    free, occupied = _log_odds(grid.free_below), _log_odds(grid.occupied_above)
    for band in bands(rows):
        log_odds = grid.log_odds[band]
        image[band] = _GREY[UNKNOWN]
        image[band][log_odds < free] = _GREY[FREE]
        image[band][log_odds > occupied] = _GREY[OCCUPIED]
    return content


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def _cone(config: GridConfig, *, touching: bool) -> kernels.Cone:
    return kernels.Cone(
        touching=touching,
        max_range=config.max_range,
        no_return_range=config.no_return_range,
        cot_min_incidence=1.0 / math.tan(config.min_incidence),
        free_margin=config.resolution,
    )


def _evidence(config: GridConfig) -> kernels.Evidence:
    limit = _log_odds(config.clamp_probability)
    if config.mode == "binary":
        # Any single observation reaches the clamp, however many cells share a hit.
        return kernels.Evidence(hit=1e6 * limit, miss=-2.0 * limit, limit=limit)
    return kernels.Evidence(hit=_log_odds(config.hit_probability), miss=_log_odds(config.miss_probability), limit=limit)


def _checked(
    trajectory: NDArray[np.float64], ranges: NDArray[np.float32], geometry: ScanGeometry
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    trajectory = np.ascontiguousarray(trajectory, dtype=np.float64)
    ranges = np.ascontiguousarray(ranges, dtype=np.float32)
    if trajectory.ndim != 2 or trajectory.shape[1] != 3 or len(trajectory) == 0:
        raise GridError(f"the trajectory has shape {trajectory.shape}, expected (n, 3) with n ≥ 1")
    if ranges.shape != (len(trajectory), geometry.n_beams):
        raise GridError(
            f"the ranges have shape {ranges.shape}, expected {(len(trajectory), geometry.n_beams)}: "
            "one row a pose, one column a beam"
        )
    bad = np.flatnonzero(~np.isfinite(trajectory).all(axis=1))
    if len(bad):
        raise GridError(f"pose {bad[0]} of the trajectory is {trajectory[bad[0]]}, expected finite numbers")
    return trajectory, ranges


def _spaced_scans(trajectory: NDArray[np.float64], min_travel: float, min_turn: float) -> NDArray[np.int64]:
    """Indices of the scans to use: the first, then each that is far enough from the last one used."""
    n = len(trajectory)
    if min_travel <= 0 and min_turn <= 0:
        return np.arange(n)
    travel = min_travel if min_travel > 0 else math.inf
    turn = min_turn if min_turn > 0 else math.inf
    used = [0]
    x0, y0, heading0 = trajectory[0].tolist()
    for index, (x, y, heading) in enumerate(trajectory.tolist()):
        turned = abs(math.remainder(heading - heading0, 2.0 * math.pi))
        if math.hypot(x - x0, y - y0) >= travel or turned >= turn:
            used.append(index)
            x0, y0, heading0 = x, y, heading
    return np.array(used)


def _laser_poses(T_map_robot: NDArray[np.float64], geometry: ScanGeometry) -> NDArray[np.float64]:
    x, y, heading = geometry.T_robot_laser
    cos, sin = cos_sin(T_map_robot[:, 2])
    return np.stack(
        [
            T_map_robot[:, 0] + cos * x - sin * y,
            T_map_robot[:, 1] + sin * x + cos * y,
            T_map_robot[:, 2] + heading,
        ],
        axis=1,
    )


def _half_widths(geometry: ScanGeometry, beam_width: float | None) -> tuple[NDArray[np.float64], bool]:
    """Angles from each beam's axis to its right and left border, and whether neighbouring beams touch."""
    bearings = np.asarray(geometry.bearings, dtype=np.float64)
    gaps = np.diff(bearings)
    half = np.empty((len(bearings), 2))
    half[1:, 0] = half[:-1, 1] = gaps / 2
    # A laser that looks all around: the last border must not lap over the first.
    room = max(2.0 * math.pi - (bearings[-1] - bearings[0]), 0.0) / 2
    half[0, 0], half[-1, 1] = min(gaps[0] / 2, room), min(gaps[-1] / 2, room)
    if beam_width is None or beam_width >= gaps.max():
        return half, True
    return np.minimum(half, beam_width / 2), False


def _frame(box: tuple[float, float, float, float], config: GridConfig) -> tuple[NDArray[np.float64], tuple[int, int]]:
    """Origin and shape of the grid around a box; cell borders lie on multiples of the resolution."""
    x_min, y_min, x_max, y_max = box
    low_x, low_y = math.floor(x_min / config.resolution) - 1, math.floor(y_min / config.resolution) - 1
    cols = math.floor(x_max / config.resolution) + 2 - low_x
    rows = math.floor(y_max / config.resolution) + 2 - low_y
    if rows * cols > config.max_cells:
        raise GridSizeError(
            f"the scans span {x_max - x_min:.0f} m x {y_max - y_min:.0f} m, {rows * cols} cells of "
            f"{config.resolution} m; at most max_cells = {config.max_cells} are allowed. Is the trajectory sound?"
        )
    return np.array([low_x * config.resolution, low_y * config.resolution]), (rows, cols)
