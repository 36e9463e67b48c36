"""Compiled loops that score a grid of poses around an optimum.

Point after point is scored at all poses together: in loops this simple, over columns and without branches, the compiler
takes eight poses at once.
"""

from math import cos, log, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both
from iceg.ice._refinement_kernels import _look_up
from iceg.ice.scored import Scored

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

_FAR = 10.0
_TOGETHER = 200
"""Factors below `_FAR` whose product cannot overflow."""


class Grid(NamedTuple):
    """(n,) each: where the robot is at each pose of the grid, cosine and sine of its heading."""

    x: F64
    y: F64
    cos: F64
    sin: F64


class Landed(NamedTuple):
    """(n,) each: one point at all poses, and the surfels it meets there, see `_refinement_kernels.look_up`."""

    x: F64
    y: F64
    cells: I32
    px: F64
    py: F64
    nx: F64
    ny: F64


@compiled_for_both
def score_grid(scored: Scored, n_picks: int, pose: F64, axes: F64, steps: F64, costs: F64) -> float:
    """Costs on a grid of poses around `pose`.

    The cost of a pose is Σ log(1 + r²/scale²) over evenly picked points, r the distance to the nearest surfel's line,
    scale² larger by the point's spread; a point that leaves the reference costs as much as one 3·scale away.

    Args:
        scored: the points and the reference.
        n_picks: how many of the points are used.
        pose: (3,) centre of the grid, T_ref_robot.
        axes: (3, 3) columns: directions of the grid in the tangent space of the robot.
        steps: (3,) spacing along each.
        costs: output, an odd number of poses along each of its three axes.

    Returns:
        The smallest cost.
    """
    points, normals = scored.points, scored.normals
    stride, inverse_scale2 = len(points) / n_picks, 1.0 / (scored.scale * scored.scale)
    grid, n = _poses(pose, axes, steps, costs.shape), costs.size
    landed = Landed(np.empty(n), np.empty(n), np.empty(n, np.int32), np.zeros(n), np.zeros(n), np.empty(n), np.empty(n))
    total, products = costs.reshape(-1), np.empty(n)
    total[:] = 0.0
    products[:] = 1.0
    for q in range(n_picks):
        i = int((q + 0.5) * stride)
        _land(grid, points[i, 0], points[i, 1], scored.nearest.shape, scored.origin, scored.cell, landed)
        _look_up(landed.cells, scored.nearest, scored.surfels, landed.px, landed.py, landed.nx, landed.ny)
        mx, my = normals[i, 0], normals[i, 1]
        least = scored.facing if mx != 0.0 or my != 0.0 else -np.inf
        _penalise(grid, mx, my, least, inverse_scale2 / scored.spreads[i], landed, products)
        # The logarithm of a product is taken now and then instead of that of every factor.
        if q % _TOGETHER == _TOGETHER - 1 or q == n_picks - 1:
            for p in range(n):
                total[p] += log(products[p])
                products[p] = 1.0
    least_cost = total[0]
    for cost in total:
        least_cost = min(least_cost, cost)
    return float(least_cost)


@compiled
def _poses(pose: F64, axes: F64, steps: F64, shape: tuple[int, int, int]) -> Grid:
    """The poses of the grid, in the order of its costs."""
    n = shape[0] * shape[1] * shape[2]
    grid = Grid(np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    half0, half1, half2 = shape[0] // 2, shape[1] // 2, shape[2] // 2
    c, s = cos(pose[2]), sin(pose[2])
    p = 0
    for i0 in range(-half0, half0 + 1):
        for i1 in range(-half1, half1 + 1):
            for i2 in range(-half2, half2 + 1):
                g0, g1, g2 = i0 * steps[0], i1 * steps[1], i2 * steps[2]
                d0 = axes[0, 0] * g0 + axes[0, 1] * g1 + axes[0, 2] * g2
                d1 = axes[1, 0] * g0 + axes[1, 1] * g1 + axes[1, 2] * g2
                turn = pose[2] + axes[2, 0] * g0 + axes[2, 1] * g1 + axes[2, 2] * g2
                grid.x[p], grid.y[p] = pose[0] + c * d0 - s * d1, pose[1] + s * d0 + c * d1
                grid.cos[p], grid.sin[p] = cos(turn), sin(turn)
                p += 1
    return grid


@compiled
def _land(grid: Grid, px: float, py: float, shape: tuple[int, int], origin: F64, cell: float, landed: Landed) -> None:
    """Where a point lies at each pose, and in which cell of the field, -1 outside."""
    x0, y0, cells_per_metre = origin[0], origin[1], 1.0 / cell
    height, width, row = float(shape[0]), float(shape[1]), np.int32(shape[1])
    xs, ys, c, s, x, y, cells = grid.x, grid.y, grid.cos, grid.sin, landed.x, landed.y, landed.cells
    for p in range(len(cells)):
        x[p] = xs[p] + c[p] * px - s[p] * py
        y[p] = ys[p] + s[p] * px + c[p] * py
        u, v = (x[p] - x0) * cells_per_metre, (y[p] - y0) * cells_per_metre
        inside = (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height)
        at = np.int32(v if inside else 0.0) * row + np.int32(u if inside else 0.0)
        cells[p] = at if inside else np.int32(-1)


@compiled
def _penalise(
    grid: Grid, mx: float, my: float, least: float, inverse_scale2: float, landed: Landed, products: F64
) -> None:
    """Multiply in 1 + r²/scale² of a point with normal mx, my, at most `_FAR`; `_FAR` where it has no surfel."""
    c, s, x, y = grid.cos, grid.sin, landed.x, landed.y
    px, py, nx, ny = landed.px, landed.py, landed.nx, landed.ny
    for p in range(len(products)):
        cosine = (c[p] * mx - s[p] * my) * nx[p] + (s[p] * mx + c[p] * my) * ny[p]
        r = nx[p] * (x[p] - px[p]) + ny[p] * (y[p] - py[p])
        factor = 1.0 + r * r * inverse_scale2
        factor = min(_FAR, factor)
        products[p] *= factor if cosine >= least else _FAR
