"""Compiled loops that fit the points of a scan to a local map."""

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

_SHRINK = 0.6
_FEWEST = 5
_STILL_M, _STILL_RAD = 2e-4, 1e-4
_NEARLY_M, _NEARLY_RAD = 0.02, 0.01


@compiled
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
def solve_step(h: F64, g: F64, damping: float, step: F64) -> bool:
    """Solve (h + damping·1)·step = -g for a symmetric 3×3 h; return whether it has an inverse."""
    h00, h11, h22 = h[0, 0] + damping, h[1, 1] + damping, h[2, 2] + damping
    h01, h02, h12 = h[0, 1], h[0, 2], h[1, 2]
    a00, a01, a02 = h11 * h22 - h12 * h12, h02 * h12 - h01 * h22, h01 * h12 - h02 * h11
    det = h00 * a00 + h01 * a01 + h02 * a02
    if abs(det) < 1e-12:
        return False
    a11, a12, a22 = h00 * h22 - h02 * h02, h01 * h02 - h00 * h12, h00 * h11 - h01 * h01
    step[0] = -(a00 * g[0] + a01 * g[1] + a02 * g[2]) / det
    step[1] = -(a01 * g[0] + a11 * g[1] + a12 * g[2]) / det
    step[2] = -(a02 * g[0] + a12 * g[1] + a22 * g[2]) / det
    return True


@compiled
def refine(
    points: F64,
    normals: F64,
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
    pose: F64,
    hessian: F64,
) -> tuple[int, int, float, float]:
    """Point-to-line Gauss-Newton with Cauchy weights.

    Args:
        points: (n, 2) in the robot frame [m].
        normals: (n, 2) of the surfaces they lie on; 0, 0 where unknown.
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
        facing: least cosine between the normals of a point and of its surfel.
        pose: (3,) output.
        hessian: (3, 3) output, Σ w JᵀJ in the reference frame, rotation about the robot.

    Returns:
        Points within 2·scale of their surfel's line, points with a partner, sum of their weights, and their weighted
        root mean square distance.
    """
    gradient, step = np.empty(3), np.empty(3)
    pose[:] = start
    inliers, used, squares, weights = 0, 0, 0.0, 0.0
    width = max(scale, first_scale)
    for _ in range(max(1, iterations)):
        inliers, used, squares, weights = _normal_equations(
            points, normals, every, pose, surfels, nearest, origin, cell, width, scale, facing, hessian, gradient
        )
        if used < _FEWEST or iterations == 0:
            break
        for a in range(3):
            gradient[a] += prior_weight * (pose[a] - start[a])
        if not solve_step(hessian, gradient, prior_weight, step):
            break
        pose += step
        moved, turned = max(abs(step[0]), abs(step[1])), abs(step[2])
        if moved < _STILL_M and turned < _STILL_RAD and width <= scale:
            break
        # A start this good needs no wide weights.
        width = scale if moved < _NEARLY_M and turned < _NEARLY_RAD else max(scale, width * _SHRINK)
    return inliers, used, weights, sqrt(squares / max(weights, 1e-9))


@compiled
def _normal_equations(
    points: F64,
    normals: F64,
    every: int,
    pose: F64,
    surfels: F64,
    nearest: I32,
    origin: F64,
    cell: float,
    width: float,
    scale: float,
    facing: float,
    hessian: F64,
    gradient: F64,
) -> tuple[int, int, float, float]:
    """Σ w JᵀJ and Σ w Jᵀr at a pose, Cauchy weights of this width; inliers, used, Σ w r², Σ w, see `refine`."""
    c, s = cos(pose[2]), sin(pose[2])
    x0, y0, cells_per_metre = origin[0], origin[1], 1.0 / cell
    inverse_width2 = 1.0 / (width * width)
    h00, h01, h02, h11, h12, h22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    g0, g1, g2 = 0.0, 0.0, 0.0
    inliers, used = 0, 0
    squares, weights = 0.0, 0.0
    for i in range(0, len(points), every):
        rx = c * points[i, 0] - s * points[i, 1]
        ry = s * points[i, 0] + c * points[i, 1]
        nx, ny = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
        x, y = pose[0] + rx, pose[1] + ry
        k = partner(x, y, nx, ny, surfels, nearest, x0, y0, cells_per_metre, facing)
        if k < 0:
            continue
        mx, my = surfels[k, 2], surfels[k, 3]
        used += 1
        r = mx * (x - surfels[k, 0]) + my * (y - surfels[k, 1])
        w = 1.0 / (1.0 + r * r * inverse_width2)
        squares += w * r * r
        weights += w
        if r * r < 4.0 * scale * scale:
            inliers += 1
        # Derivative with respect to a step in the reference frame, rotation about the robot.
        j2 = my * rx - mx * ry
        h00 += w * mx * mx
        h01 += w * mx * my
        h11 += w * my * my
        h02 += w * mx * j2
        h12 += w * my * j2
        h22 += w * j2 * j2
        g0 += w * mx * r
        g1 += w * my * r
        g2 += w * j2 * r
    hessian[0, 0], hessian[0, 1], hessian[0, 2] = h00, h01, h02
    hessian[1, 0], hessian[1, 1], hessian[1, 2] = h01, h11, h12
    hessian[2, 0], hessian[2, 1], hessian[2, 2] = h02, h12, h22
    gradient[0], gradient[1], gradient[2] = g0, g1, g2
    return inliers, used, squares, weights
