"""How much of each scan the finished map explains."""

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.se2 import transform_points
from iceg.maps.grid import OccupancyGrid, bands

_FEWEST = 5
"""Of fewer returns no share is told."""
_AT_ONCE = 500


def explained_shares(
    log: Log, scans: NDArray[np.int64], poses: NDArray[np.float64], grid: OccupancyGrid
) -> NDArray[np.float64]:
    """Share of the returns of each scan that end in an occupied cell of the map or right beside one.

    Args:
        log: the log.
        scans: (k,) which scans.
        poses: (k, 3) where they were taken, T_map_robot.
        grid: the map.

    Returns:
        (k,) shares; NaN where too few beams return.
    """
    near = _near_occupied(grid)
    shares = np.full(len(scans), np.nan)
    for first in range(0, len(scans), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        ranges = log.ranges[scans[some]].astype(np.float64)
        returned = np.isfinite(ranges)
        ends = log.geometry.origin_robot + np.nan_to_num(ranges)[..., None] * log.geometry.directions_robot
        rows, columns = grid.cell(transform_points(poses[some, None], ends))
        inside = (rows >= 0) & (rows < near.shape[0]) & (columns >= 0) & (columns < near.shape[1]) & returned
        hit = near[np.where(inside, rows, 0), np.where(inside, columns, 0)] & inside
        counts = returned.sum(axis=1)
        shares[some] = np.where(counts >= _FEWEST, hit.sum(axis=1) / np.maximum(counts, 1), np.nan)
    return shares


def _near_occupied(grid: OccupancyGrid) -> NDArray[np.bool_]:
    """(n_rows, n_cols) the occupied cells and the eight around each."""
    near = np.empty(grid.shape, np.bool_)
    for band in bands(len(near)):
        first = max(band.start - 1, 0)
        occupied = grid.log_odds[first : band.stop + 1] > 0.0
        tall = occupied.copy()
        tall[1:] |= occupied[:-1]
        tall[:-1] |= occupied[1:]
        wide = tall.copy()
        wide[:, 1:] |= tall[:, :-1]
        wide[:, :-1] |= tall[:, 1:]
        near[band] = wide[band.start - first : band.stop - first]
    return near
