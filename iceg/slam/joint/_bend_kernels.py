"""Compiled loop that tells how a wall runs on from piece to piece: how it is turned and how it bends at each."""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_LEAST_SPREAD = 1e-3
"""Of the places of the pieces along the wall, as a share of the square of their reach: nearer together, they tell no
bend."""


@compiled
def bends_along(lines: F64, weights: F64, order: I64, reach: float, facing: float, across: float, bends: F64) -> None:
    """Fit a curve to each piece of wall and those around it that lie on one with it, by their directions.

    Args:
        lines: (m, 4) a point and the unit normal of each piece.
        weights: (m,) of the points on each.
        order: (m,) the pieces by x.
        reach: farthest from one another [m].
        facing: least cosine between the normals of two on one curve.
        across: farthest that one lies off the arc that their directions make of the way between them [m].
        bends: (m, 2) output: by how much the curve is turned against the line at the point of each, counter-clockwise
            [rad], and how much more per metre along it [rad/m]; zeros where no other piece lies on one with it.
    """
    sums = np.zeros((len(lines), 5))
    for i in range(len(lines)):
        sums[i, 0] = weights[i]
    for a in range(len(order)):
        i = order[a]
        for b in range(a + 1, len(order)):
            j = order[b]
            if lines[j, 0] - lines[i, 0] > reach:
                break
            dx, dy = lines[j, 0] - lines[i, 0], lines[j, 1] - lines[i, 1]
            if dx * dx + dy * dy <= reach * reach:
                _tell(lines, weights, i, j, facing, across, sums)
                _tell(lines, weights, j, i, facing, across, sums)
    for i in range(len(lines)):
        w, ws, wss, turned, bent = sums[i, 0], sums[i, 1], sums[i, 2], sums[i, 3], sums[i, 4]
        spread = w * wss - ws * ws
        bends[i, 0], bends[i, 1] = 0.0, 0.0
        if spread > _LEAST_SPREAD * reach * reach * w * w:
            bends[i, 0], bends[i, 1] = (wss * turned - ws * bent) / spread, (w * bent - ws * turned) / spread


@compiled
def _tell(lines: F64, weights: F64, i: int, j: int, facing: float, across: float, sums: F64) -> None:
    """Add to the sums of a piece what another says, if both lie on one curve: an arc is turned twice as its chord."""
    dx, dy = lines[j, 0] - lines[i, 0], lines[j, 1] - lines[i, 1]
    nx, ny, mx, my = lines[i, 2], lines[i, 3], lines[j, 2], lines[j, 3]
    along, off, turn = nx * dy - ny * dx, nx * dx + ny * dy, nx * my - ny * mx
    if nx * mx + ny * my < facing or abs(off + 0.5 * turn * along) > across:
        return
    w = weights[j]
    sums[i, 0] += w
    sums[i, 1] += w * along
    sums[i, 2] += w * along * along
    sums[i, 3] += w * turn
    sums[i, 4] += w * along * turn
