"""Compiled loops that weigh the poses around an optimum: what the points of a scan say of its uncertainty."""

from math import cos, exp, log, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled
from iceg.ice._refinement_kernels import partner

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
Bool = NDArray[np.bool_]

_FAR = 10.0
_LAGS = 12
_TELLING = 10.0
"""So many points must hold a direction for their own residuals to count as much as those of all."""


@compiled
def dependence(
    points: F64,
    normals: F64,
    pose: F64,
    surfels: F64,
    nearest: I32,
    origin: F64,
    cell: float,
    facing: float,
    limit: float,
) -> float:
    """How many neighbouring points say the same: 1 + 2 Σ (1 - l/13) ρ_l over the lags l = 1..12, at least 1.

    ρ_l is the correlation of the residuals of points l apart, among those with a residual below `limit`.
    """
    n = len(points)
    residuals = np.empty(n)
    c, s = cos(pose[2]), sin(pose[2])
    squares, used = 0.0, 0
    for i in range(n):
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        nx, ny = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
        k = partner(x, y, nx, ny, surfels, nearest, origin[0], origin[1], 1.0 / cell, facing)
        residuals[i] = 0.0
        if k < 0:
            continue
        r = surfels[k, 2] * (x - surfels[k, 0]) + surfels[k, 3] * (y - surfels[k, 1])
        if abs(r) < limit:
            residuals[i] = r
            squares += r * r
            used += 1
    if used < 2 * _LAGS or squares <= 0.0:
        return 1.0
    total = 0.0
    for lag in range(1, _LAGS + 1):
        products = 0.0
        for i in range(lag, n):
            products += residuals[i] * residuals[i - lag]
        total += (1.0 - lag / (_LAGS + 1.0)) * products
    return max(1.0, 1.0 + 2.0 * total / squares)


@compiled
def unevenness(
    points: F64,
    normals: F64,
    pose: F64,
    axes: F64,
    surfels: F64,
    nearest: I32,
    origin: F64,
    cell: float,
    facing: float,
    limit: float,
    least: float,
    variance: float,
    ratios: F64,
) -> None:
    """How much larger the variance along each axis is than if every point were off by the same `variance`.

    A direction is known as well as the points that hold it: those of a wall far ahead scatter more than those of the
    walls beside. Along an axis v point i pulls with gᵢ = rᵢ Jᵢv; White's and Newey's (1987) estimate takes Σ gᵢ², and
    what neighbours share, in the place of variance · Σ (Jᵢv)². Where few points hold the axis they are too few to tell
    and the ratio keeps near 1.

    Args:
        points: (n, 2) in the robot frame [m].
        normals: (n, 2); 0, 0 where unknown.
        pose: (3,) the optimum.
        axes: (3, 3) columns, in the tangent space of the robot.
        surfels: (m, 4) of the reference.
        nearest: (ny, nx) of its field.
        origin: (2,) lower left corner of the field [m].
        cell: width of its cells [m].
        facing: least cosine between the normals of a point and of its surfel.
        limit: residuals beyond this tell of something else [m].
        least: a residual's variance is never taken to be smaller [m²].
        variance: of a residual, times how many neighbours say the same [m²].
        ratios: (3,) output.
    """
    n = len(points)
    pulls, levers = np.zeros((n, 3)), np.zeros((n, 3))
    c, s = cos(pose[2]), sin(pose[2])
    for i in range(n):
        px, py = points[i, 0], points[i, 1]
        x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        nx, ny = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
        k = partner(x, y, nx, ny, surfels, nearest, origin[0], origin[1], 1.0 / cell, facing)
        if k < 0:
            continue
        mx, my = surfels[k, 2], surfels[k, 3]
        r = mx * (x - surfels[k, 0]) + my * (y - surfels[k, 1])
        if abs(r) >= limit:
            continue
        jx, jy = c * mx + s * my, c * my - s * mx
        turn = jy * px - jx * py
        for a in range(3):
            levers[i, a] = jx * axes[0, a] + jy * axes[1, a] + turn * axes[2, a]
            pulls[i, a] = r * levers[i, a]
    for a in range(3):
        ratios[a] = _ratio(levers[:, a], pulls[:, a], least, variance)


@compiled
def _ratio(levers: F64, pulls: F64, least: float, variance: float) -> float:
    """The ratio of `unevenness` along one axis, from (n,) Jᵢv and (n,) rᵢ Jᵢv."""
    squares, fourth, meat = 0.0, 0.0, 0.0
    for i in range(len(levers)):
        lever2 = levers[i] * levers[i]
        squares += lever2
        fourth += lever2 * lever2
        meat += pulls[i] * pulls[i]
    if squares <= 0.0:
        return 1.0
    shared = 0.0
    for lag in range(1, _LAGS + 1):
        products = 0.0
        for i in range(lag, len(levers)):
            products += pulls[i] * pulls[i - lag]
        shared += (1.0 - lag / (_LAGS + 1.0)) * products
    meat = max(meat + 2.0 * max(shared, 0.0), least * squares)
    held_by = squares * squares / fourth
    return float((_TELLING + held_by * meat / (variance * squares)) / (_TELLING + held_by))


@compiled
def principal_axes(matrix: F64, values: F64, axes: F64) -> None:
    """Eigenvalues and eigenvectors (columns) of a symmetric 3×3 matrix, by Jacobi rotations."""
    a = matrix.copy()
    axes[:] = 0.0
    axes[0, 0], axes[1, 1], axes[2, 2] = 1.0, 1.0, 1.0
    for _ in range(30):
        p, q = 0, 1
        if abs(a[0, 2]) > abs(a[p, q]):
            p, q = 0, 2
        if abs(a[1, 2]) > abs(a[p, q]):
            p, q = 1, 2
        if abs(a[p, q]) <= 1e-14 * (abs(a[p, p]) + abs(a[q, q])):
            break
        theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
        t = 1.0 / (abs(theta) + sqrt(theta * theta + 1.0))
        if theta < 0.0:
            t = -t
        c = 1.0 / sqrt(t * t + 1.0)
        s = t * c
        for k in range(3):
            kp, kq = a[k, p], a[k, q]
            a[k, p], a[k, q] = c * kp - s * kq, s * kp + c * kq
        for k in range(3):
            pk, qk = a[p, k], a[q, k]
            a[p, k], a[q, k] = c * pk - s * qk, s * pk + c * qk
            kp, kq = axes[k, p], axes[k, q]
            axes[k, p], axes[k, q] = c * kp - s * kq, s * kp + c * kq
    for k in range(3):
        values[k] = a[k, k]


@compiled
def score_grid(
    points: F64,
    normals: F64,
    n_picks: int,
    surfels: F64,
    nearest: I32,
    origin: F64,
    cell: float,
    scale: float,
    facing: float,
    pose: F64,
    axes: F64,
    steps: F64,
    costs: F64,
) -> float:
    """Costs on a grid of poses around `pose`.

    The cost of a pose is Σ log(1 + r²/scale²) over evenly picked points, r the distance to the nearest surfel's line;
    a point that leaves the reference costs as much as one 3·scale away.

    Args:
        points: (n, 2) in the robot frame [m].
        normals: (n, 2); 0, 0 where unknown.
        n_picks: how many of the points are used.
        surfels: (m, 4) of the reference.
        nearest: (ny, nx) of its field.
        origin: (2,) lower left corner of the field [m].
        cell: width of its cells [m].
        scale: width of the Cauchy cost [m].
        facing: least cosine between the normals of a point and of its surfel.
        pose: (3,) centre of the grid, T_ref_robot.
        axes: (3, 3) columns: directions of the grid in the tangent space of the robot.
        steps: (3,) spacing along each.
        costs: output, an odd number of poses along each of its three axes.

    Returns:
        The smallest cost.
    """
    half0, half1, half2 = costs.shape[0] // 2, costs.shape[1] // 2, costs.shape[2] // 2
    inverse_scale2 = 1.0 / (scale * scale)
    c0, s0 = cos(pose[2]), sin(pose[2])
    best = np.inf
    for i0 in range(-half0, half0 + 1):
        for i1 in range(-half1, half1 + 1):
            for i2 in range(-half2, half2 + 1):
                g0, g1, g2 = i0 * steps[0], i1 * steps[1], i2 * steps[2]
                d0 = axes[0, 0] * g0 + axes[0, 1] * g1 + axes[0, 2] * g2
                d1 = axes[1, 0] * g0 + axes[1, 1] * g1 + axes[1, 2] * g2
                turn = pose[2] + axes[2, 0] * g0 + axes[2, 1] * g1 + axes[2, 2] * g2
                x0, y0 = pose[0] + c0 * d0 - s0 * d1, pose[1] + s0 * d0 + c0 * d1
                cost = _cost(
                    points, normals, n_picks, surfels, nearest, origin, cell, inverse_scale2, facing, x0, y0, turn
                )
                costs[i0 + half0, i1 + half1, i2 + half2] = cost
                best = min(best, cost)
    return best


@compiled
def _cost(
    points: F64,
    normals: F64,
    n_picks: int,
    surfels: F64,
    nearest: I32,
    origin: F64,
    cell: float,
    inverse_scale2: float,
    facing: float,
    x0: float,
    y0: float,
    turn: float,
) -> float:
    """The cost of one pose x0, y0, turn, see `score_grid`."""
    stride = len(points) / n_picks
    x00, y00, cells_per_metre = origin[0], origin[1], 1.0 / cell
    c, s = cos(turn), sin(turn)
    # The logarithm of a product is taken now and then instead of that of every factor.
    cost, product = 0.0, 1.0
    for q in range(n_picks):
        i = int((q + 0.5) * stride)
        x = x0 + c * points[i, 0] - s * points[i, 1]
        y = y0 + s * points[i, 0] + c * points[i, 1]
        nx, ny = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
        k = partner(x, y, nx, ny, surfels, nearest, x00, y00, cells_per_metre, facing)
        factor = _FAR
        if k >= 0:
            r = surfels[k, 2] * (x - surfels[k, 0]) + surfels[k, 3] * (y - surfels[k, 1])
            factor = min(_FAR, 1.0 + r * r * inverse_scale2)
        product *= factor
        if product > 1e200:
            cost += log(product)
            product = 1.0
    return cost + log(product)


@compiled
def moments(costs: F64, best: float, per_cost: float, steps: F64, second: F64, edges: F64) -> None:
    """Turn costs into normalised weights exp(-per_cost·(cost - best)), in place, and take their central second moment.

    Args:
        costs: (side, side, side); becomes the weights.
        best: the smallest cost.
        per_cost: how much a cost counts.
        steps: (3,) spacing of the grid.
        second: (3, 3) output: K/s - uuᵀ/s² along the axes of the grid, a cell's own width included.
        edges: (3,) output: weight on the two outermost layers across each axis.
    """
    side = costs.shape[0]
    half = side // 2
    total = 0.0
    mean = np.zeros(3)
    second[:] = 0.0
    edges[:] = 0.0
    g = np.empty(3)
    for i0 in range(side):
        for i1 in range(side):
            for i2 in range(side):
                w = exp(-per_cost * (costs[i0, i1, i2] - best))
                costs[i0, i1, i2] = w
                total += w
                g[0], g[1], g[2] = (i0 - half) * steps[0], (i1 - half) * steps[1], (i2 - half) * steps[2]
                for a in range(3):
                    mean[a] += w * g[a]
                    for b in range(3):
                        second[a, b] += w * g[a] * g[b]
                edges[0] += w if i0 == 0 or i0 == side - 1 else 0.0
                edges[1] += w if i1 == 0 or i1 == side - 1 else 0.0
                edges[2] += w if i2 == 0 or i2 == side - 1 else 0.0
    for a in range(3):
        for b in range(3):
            second[a, b] = second[a, b] / total - mean[a] * mean[b] / (total * total)
        second[a, a] += steps[a] ** 2 / 12.0
        edges[a] /= total
    costs /= total


@compiled
def score_covariance(
    points: F64,
    normals: F64,
    n_picks: int,
    surfels: F64,
    nearest: I32,
    origin: F64,
    cell: float,
    scale: float,
    facing: float,
    pose: F64,
    hessian: F64,
    sigma: float,
    share: float,
    temperature: float,
    spacing: float,
    min_step: float,
    max_step: float,
    edge_mass: float,
    weak_sigma: float,
    covariance: F64,
    axes: F64,
    steps: F64,
    weights: F64,
    weak: Bool,
) -> None:
    """Second moment of the scores around an optimum, on a grid along the principal axes of its Hessian.

    Args:
        points: see `score_grid`, as the following up to `pose`.
        normals: …
        n_picks: …
        surfels: …
        nearest: …
        origin: …
        cell: …
        scale: …
        facing: …
        pose: …
        hessian: (3, 3) in the reference frame, unit residual variance.
        sigma: standard deviation of a residual [m].
        share: of the points that count as independent.
        temperature: the scores are flattened by it, their second moment is divided by it.
        spacing: of the grid, in standard deviations of the flattened Hessian's Gaussian.
        min_step: least spacing [m or rad] …
        max_step: … and largest.
        edge_mass: with more weight than this on the edge of the largest grid a direction is unobservable.
        weak_sigma: standard deviation it is given [m or rad].
        covariance: (3, 3) output, tangent space of the robot.
        axes: (3, 3) output, columns.
        steps: (3,) output.
        weights: (side, side, side) output.
        weak: (3,) output, which axes are unobservable.
    """
    c, s = cos(pose[2]), sin(pose[2])
    turn = np.zeros((3, 3))
    turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1], turn[2, 2] = c, s, -s, c, 1.0
    precision = share / (temperature * sigma * sigma)
    information = np.empty((3, 3))
    _turned(turn, hessian, information)
    information *= precision
    values, edges, second = np.empty(3), np.empty(3), np.empty((3, 3))
    principal_axes(information, values, axes)
    for a in range(3):
        steps[a] = min(max_step, max(min_step, spacing / sqrt(max(values[a], 1e-9))))
    best = score_grid(
        points, normals, n_picks, surfels, nearest, origin, cell, scale, facing, pose, axes, steps, weights
    )
    per_cost = 0.5 * (scale / sigma) ** 2 * share / temperature * len(points) / n_picks
    moments(weights, best, per_cost, steps, second, edges)
    second /= temperature
    for a in range(3):
        weak[a] = edges[a] > edge_mass and steps[a] >= 0.999 * max_step
        if weak[a]:
            second[a, :] = 0.0
            second[:, a] = 0.0
            second[a, a] = weak_sigma * weak_sigma
    _turned(axes, second, covariance)
    for a in range(3):
        for b in range(a):
            covariance[b, a] = covariance[a, b]


@compiled
def _turned(basis: F64, matrix: F64, out: F64) -> None:
    """Basis · matrix · basisᵀ, all (3, 3)."""
    for a in range(3):
        for b in range(3):
            total = 0.0
            for p in range(3):
                for q in range(3):
                    total += basis[a, p] * matrix[p, q] * basis[b, q]
            out[a, b] = total
