"""The occupancy grid of a run for its report: 16 shades a cell, coarser where it is very large."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iceg.maps.grid import OccupancyGrid, bands
from iceg.report.packing import packed

_MOST_CELLS = 6_000_000
_UNKNOWN, _SHADES = 0, 15
"""Shade 0 is unknown; 1 is free beyond doubt, 15 occupied beyond doubt."""


def grid_payload(grid: OccupancyGrid) -> Mapping[str, Any]:
    """Cells as half bytes, row 0 the lowest y, the left of two cells in the lower half of a byte."""
    factor = max(1, math.ceil(math.sqrt(grid.log_odds.size / _MOST_CELLS)))
    log_odds = _coarser(grid.log_odds, factor)
    rows, columns = log_odds.shape
    flat = np.zeros((rows * columns + 1) // 2 * 2, dtype=np.uint8)
    most = float(max(log_odds.max(initial=0.0), -log_odds.min(initial=0.0))) or 1.0
    for band in bands(rows):
        flat[band.start * columns : band.stop * columns] = _shades(log_odds[band], most).ravel()
    return {
        "rows": rows,
        "columns": columns,
        "resolution": grid.resolution * factor,
        "origin": grid.origin.tolist(),
        "coarser": factor,
        "shades": packed(flat[0::2] | (flat[1::2] << 4), "u1"),
    }


def _shades(log_odds: NDArray[np.float32], most: float) -> NDArray[np.uint8]:
    """(rows, columns) shades, linear in the log-odds between `most` either way."""
    middle = (_SHADES + 1) // 2
    shades = middle + np.sign(log_odds) * np.ceil((middle - 1) * np.abs(log_odds) / most)
    shades[log_odds == 0.0] = _UNKNOWN
    return np.asarray(shades, dtype=np.uint8)


def _coarser(log_odds: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Cells `factor` times as wide; each what its likeliest wall says, or else its best known free cell."""
    if factor == 1:
        return log_odds
    rows, columns = (-(-size // factor) for size in log_odds.shape)
    coarse = np.empty((rows, columns), dtype=np.float32)
    for row, band in enumerate(coarse):
        fine = np.zeros((factor, columns * factor), dtype=np.float32)
        part = log_odds[row * factor : (row + 1) * factor]
        fine[: len(part), : part.shape[1]] = part
        cells = fine.reshape(factor, columns, factor)
        most, least = cells.max(axis=(0, 2)), cells.min(axis=(0, 2))
        band[:] = np.where(most > 0.0, most, least)
    return coarse
