"""Compiled loops that fit the points of a scan to a local map.

Each step of the fit goes over all points several times, with little to do each time: loops this simple, over columns
and without branches, the compiler turns into instructions that take eight points at once. Only the look-up of surfels,
and the sums, which must be added up in one order, go from point to point.
"""

from math import cos, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph.compiled import compiled, compiled_for_both
from iceg.ice._telling_kernels import beyond_end

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
Bool = NDArray[np.bool_]

_SHRINK = 0.6
"""Factor from step to step by which the Cauchy weight narrows."""
_FEWEST = 5
"""A fit needs at least so many points with a partner."""
_STILL_M, _STILL_RAD = 2e-4, 1e-4
"""A step shorter than this is the last [m, rad]."""
_NEARLY_M, _NEARLY_RAD = 0.02, 0.01
"""After a step shorter than this the weights are narrow at once [m, rad]."""


@compiled_for_both
def partner(
    x: float,
    y: float,
    mx: float,
    my: float,
    surfels: F64,
    nearest: I32,
    x0: float,
    y0: float,
    cells_per_metre: float,
    facing: float,
) -> int:
    """Index of the surfel nearest to (x, y), -1 where none is near or it faces another way than (mx, my)."""
    u, v = (x - x0) * cells_per_metre, (y - y0) * cells_per_metre
    if not (u >= 0.0 and v >= 0.0 and u < nearest.shape[1] and v < nearest.shape[0]):
        return -1
    k = nearest[np.uint32(v), np.uint32(u)]
    if k >= 0 and mx * surfels[k, 2] + my * surfels[k, 3] < facing and (mx != 0.0 or my != 0.0):
        return -1
    return int(k)


@compiled
def _solve_step(h: F64, gradient: F64, pull: float, pose: F64, start: F64, step: F64) -> bool:
    """Solve (h + pull·1)·step = -gradient - pull·(pose - start) for a symmetric 3×3 h; return whether it can be."""
    g0 = gradient[0] + pull * (pose[0] - start[0])
    g1 = gradient[1] + pull * (pose[1] - start[1])
    g2 = gradient[2] + pull * (pose[2] - start[2])
    h00, h11, h22 = h[0, 0] + pull, h[1, 1] + pull, h[2, 2] + pull
    h01, h02, h12 = h[0, 1], h[0, 2], h[1, 2]
    a00, a01, a02 = h11 * h22 - h12 * h12, h02 * h12 - h01 * h22, h01 * h12 - h02 * h11
    det = h00 * a00 + h01 * a01 + h02 * a02
    if abs(det) < 1e-12:
        return False
    a11, a12, a22 = h00 * h22 - h02 * h02, h01 * h02 - h00 * h12, h00 * h11 - h01 * h01
    step[0] = -(a00 * g0 + a01 * g1 + a02 * g2) / det
    step[1] = -(a01 * g0 + a11 * g1 + a12 * g2) / det
    step[2] = -(a02 * g0 + a12 * g1 + a22 * g2) / det
    return True


@compiled_for_both
def refine(
    points: F64,
    normals: F64,
    spreads: F64,
    every: int,
    start: F64,
    surfels: F64,
    nearest: I32,
    origin: F64,
    cell: float,
    first_scale: float,
    scale: float,
    iterations: int,
    prior_weight: float,
    facing: float,
    alike: float,
    pose: F64,
    hessian: F64,
) -> tuple[int, int, float, float]:
    """Point-to-line Gauss-Newton with Cauchy weights.

    All points with a partner count, but only those on the surface of theirs tell where to go (`_telling_kernels`).

    Args:
        points: (n, 2) in the robot frame [m].
        normals: (n, 2) of the surfaces they lie on; 0, 0 where unknown.
        spreads: (n,) variance of each in that of a typical point: so much wider is the square of its weight.
        every: only every so many points are used.
        start: (3,) T_ref_robot to start from.
        surfels: (m, 4) x, y and unit normal of the reference.
        nearest: (ny, nx) of the field.
        origin: (2,) lower left corner of the field [m].
        cell: width of its cells [m].
        first_scale: width of the Cauchy weight at the first step [m]; it shrinks …
        scale: … to this.
        iterations: most steps; with 0 the start is only judged.
        prior_weight: pull towards the start, in points.
        facing: least cosine between the normals of a point and of its surfel …
        alike: … and of those that tell where the scan lies.
        pose: (3,) output.
        hessian: (3, 3) output, Σ w JᵀJ in the reference frame, rotation about the robot.

    Returns:
        Points within 2·scale of their surfel's line, points with a partner, sum of their Cauchy weights, and their
        weighted root mean square distance, as if all were typical.
    """
    columns, pairs = _columns(points, normals, spreads, every, facing), _room(-(-len(points) // every))
    gradient, step = np.empty(3), np.empty(3)
    assign(pose, start)
    inliers, used, squares, weights, width = 0, 0, 0.0, 0.0, max(scale, first_scale)
    for _ in range(max(1, iterations)):
        _cells_at(columns.x, columns.y, pose, nearest.shape, origin, cell, pairs.rx, pairs.ry, pairs.cells)
        _look_up(pairs.cells, nearest, surfels, pairs.px, pairs.py, pairs.nx, pairs.ny)
        _mark_facing(columns, pose[2], alike, pairs)
        _mark_ends(pose, surfels, nearest, origin, cell, pairs)
        _measure(pose, pairs)
        used, inliers = _weigh(columns.spreads, pairs, 1.0 / (width * width), 4.0 * scale * scale)
        squares, weights = _add_up(columns.spreads, pairs, hessian, gradient)
        if used < _FEWEST or iterations == 0 or not _solve_step(hessian, gradient, prior_weight, pose, start, step):
            break
        pose += step
        moved, turned = max(abs(step[0]), abs(step[1])), abs(step[2])
        if moved < _STILL_M and turned < _STILL_RAD and width <= scale:
            break
        # A start this good needs no wide weights.
        width = scale if moved < _NEARLY_M and turned < _NEARLY_RAD else max(scale, width * _SHRINK)
    return inliers, used, weights, sqrt(squares / max(weights, 1e-9))


class Columns(NamedTuple):
    """(n,) each: points in the robot frame, their normals, the least cosine between these and a surfel's, spreads."""

    x: F64
    y: F64
    nx: F64
    ny: F64
    least: F64
    spreads: F64


class Pairs(NamedTuple):
    """(n,) each: points and their surfels at one pose, in the reference frame.

    Attributes:
        rx: x of each point, seen from the robot [m].
        ry: y of it.
        cells: which cell of the field it lies in, -1 outside.
        px: x of its surfel [m]; then its distance from the surfel's line.
        py: y of it; then the derivative of the distance by the heading.
        nx: normal of the surfel, NaN without one; then 0 for points that do not count, or tell nothing …
        ny: … as this.
        weights: of each point, 0 where it does not count.
        tells: whether it says where the scan lies.
    """

    rx: F64
    ry: F64
    cells: I32
    px: F64
    py: F64
    nx: F64
    ny: F64
    weights: F64
    tells: Bool


@compiled
def _columns(points: F64, normals: F64, spreads: F64, every: int, facing: float) -> Columns:
    """Every so many points as columns; one without a normal may face either way."""
    n = -(-len(points) // every)
    columns = Columns(np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    for i in range(n):
        columns.x[i], columns.y[i] = points[i * every, 0], points[i * every, 1]
        nx, ny = normals[i * every, 0], normals[i * every, 1]
        columns.nx[i], columns.ny[i] = nx, ny
        columns.least[i] = facing if nx != 0.0 or ny != 0.0 else -np.inf
        columns.spreads[i] = spreads[i * every]
    return columns


@compiled
def _room(n: int) -> Pairs:
    return Pairs(
        np.empty(n),
        np.empty(n),
        np.empty(n, np.int32),
        np.zeros(n),
        np.zeros(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n, np.bool_),
    )


@compiled
def _cells_at(
    xs: F64, ys: F64, pose: F64, shape: tuple[int, int], origin: F64, cell: float, rx: F64, ry: F64, cells: I32
) -> None:
    """Turn points by the heading of a pose into rx, ry; and find the cells they lie in there, -1 outside."""
    c, s, px, py = cos(pose[2]), sin(pose[2]), pose[0], pose[1]
    x0, y0, cells_per_metre = origin[0], origin[1], 1.0 / cell
    height, width, row = float(shape[0]), float(shape[1]), np.int32(shape[1])
    for i in range(len(cells)):
        rx[i] = c * xs[i] - s * ys[i]
        ry[i] = s * xs[i] + c * ys[i]
        u, v = ((px + rx[i]) - x0) * cells_per_metre, ((py + ry[i]) - y0) * cells_per_metre
        inside = (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height)
        at = np.int32(v if inside else 0.0) * row + np.int32(u if inside else 0.0)
        cells[i] = at if inside else np.int32(-1)


@compiled
def _look_up(cells: I32, nearest: I32, surfels: F64, px: F64, py: F64, nx: F64, ny: F64) -> None:
    """Position and normal of the surfel nearest to each cell; NaN in place of the normal where there is none."""
    flat = nearest.reshape(-1)
    for i in range(len(cells)):
        k = np.int32(-1)
        if cells[i] >= 0:
            k = flat[np.uint32(cells[i])]
        if k >= 0:
            surfel = surfels[np.uint32(k)]
            px[i], py[i], nx[i], ny[i] = surfel[0], surfel[1], surfel[2], surfel[3]
        else:
            nx[i] = np.nan


@compiled
def _mark_facing(columns: Columns, heading: float, alike: float, pairs: Pairs) -> None:
    """Weight 1 for the points that have a surfel and face the same way, 0 for the others; and which face alike."""
    c, s = cos(heading), sin(heading)
    mx, my, least, nx, ny, weights = columns.nx, columns.ny, columns.least, pairs.nx, pairs.ny, pairs.weights
    tells = pairs.tells
    for i in range(len(weights)):
        cosine = (c * mx[i] - s * my[i]) * nx[i] + (s * mx[i] + c * my[i]) * ny[i]
        weights[i] = 1.0 if cosine >= least[i] else 0.0
        tells[i] = (cosine >= alike) | (least[i] == -np.inf)


@compiled
def _mark_ends(pose: F64, surfels: F64, nearest: I32, origin: F64, cell: float, pairs: Pairs) -> None:
    """Points beyond the end of their surface tell nothing."""
    x, y, rx, ry, px, py, nx, ny = pose[0], pose[1], pairs.rx, pairs.ry, pairs.px, pairs.py, pairs.nx, pairs.ny
    flat, tells, is_far = nearest.reshape(-1), pairs.tells, np.empty(len(rx), np.bool_)
    for i in range(len(rx)):
        along = nx[i] * ((y + ry[i]) - py[i]) - ny[i] * ((x + rx[i]) - px[i])
        is_far[i] = tells[i] & (abs(along) > cell)
    for i in range(len(rx)):
        if is_far[i] and pairs.weights[i] > 0.0:
            k = flat[np.uint32(pairs.cells[i])]
            tells[i] = not beyond_end(x + rx[i], y + ry[i], k, surfels, nearest, origin[0], origin[1], 1.0 / cell)


@compiled
def _measure(pose: F64, pairs: Pairs) -> None:
    """Distance of each point from its surfel's line, and its derivative by a rotation about the robot."""
    x, y, rx, ry, px, py, nx, ny = pose[0], pose[1], pairs.rx, pairs.ry, pairs.px, pairs.py, pairs.nx, pairs.ny
    for i in range(len(rx)):
        px[i] = nx[i] * ((x + rx[i]) - px[i]) + ny[i] * ((y + ry[i]) - py[i])
        py[i] = ny[i] * rx[i] - nx[i] * ry[i]


@compiled
def _weigh(spreads: F64, pairs: Pairs, inverse_width2: float, inlier2: float) -> tuple[int, int]:
    """Weights of the points that count, zeros for the others; how many count, and how many lie so near.

    A weight is that of Cauchy, for a width that suits the point, over the point's variance.
    """
    distances, levers, nx, ny, weights = pairs.px, pairs.py, pairs.nx, pairs.ny, pairs.weights
    tells = pairs.tells
    used, inliers = 0, 0
    for i in range(len(weights)):
        counts = weights[i] > 0.0
        square = distances[i] * distances[i]
        used += 1 if counts else 0
        inliers += 1 if counts and square < inlier2 * spreads[i] else 0
        weights[i] = 1.0 / (spreads[i] + square * inverse_width2) if counts else 0.0
        distances[i] = distances[i] if counts else 0.0
        moves = counts & tells[i]
        levers[i] = levers[i] if moves else 0.0
        nx[i] = nx[i] if moves else 0.0
        ny[i] = ny[i] if moves else 0.0
    return used, inliers


@compiled
def _add_up(spreads: F64, pairs: Pairs, hessian: F64, gradient: F64) -> tuple[float, float]:
    """Σ w JᵀJ and Σ w Jᵀr; return Σ w r² and the sum of the Cauchy weights, which are w times the spreads."""
    h00, h01, h02, h11, h12, h22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    g0, g1, g2 = 0.0, 0.0, 0.0
    squares, weights = 0.0, 0.0
    for i in range(len(pairs.weights)):
        r, lever, mx, my, w = pairs.px[i], pairs.py[i], pairs.nx[i], pairs.ny[i], pairs.weights[i]
        squares += w * r * r
        weights += w * spreads[i]
        # Derivative with respect to a step in the reference frame, rotation about the robot.
        h00 += w * mx * mx
        h01 += w * mx * my
        h11 += w * my * my
        h02 += w * mx * lever
        h12 += w * my * lever
        h22 += w * lever * lever
        g0 += w * mx * r
        g1 += w * my * r
        g2 += w * lever * r
    hessian[0, 0], hessian[0, 1], hessian[0, 2] = h00, h01, h02
    hessian[1, 0], hessian[1, 1], hessian[1, 2] = h01, h11, h12
    hessian[2, 0], hessian[2, 1], hessian[2, 2] = h02, h12, h22
    gradient[0], gradient[1], gradient[2] = g0, g1, g2
    return squares, weights
