"""Compiled normal equations of the joint refinement: points on lines, the lines eliminated.

The line of a piece of wall (offset and direction) is an unknown beside the poses. It is eliminated, so that the system
that remains is one of poses alone.
"""

from math import cos, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import ZERO, compiled

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_LOOSE = 1e-3
"""Weight of a prior on a line, in points: few points alone would leave it undetermined."""
_PRIOR_LENGTH = 0.05


class PointsOnLines(NamedTuple):
    """The points that hang on poses, and the lines they lie on.

    Attributes:
        starts: (k + 1,) first point of each pose.
        placed: (n, 2) points in the map [m].
        errors: (n, 2) their standard deviations along their beams [m].
        piece_of: (n,) line of each point, -1 for none.
        lines: (m, 4) a point and the unit normal of each.
        residuals: (n,) distance of each point from its line [m].
        weights: (n,) of the points.
        roughness: standard deviation of a surface about its line [m].
        bends: (m, 2) by how much the wall is turned against each line, and how much more per metre (`_bend_kernels`).
    """

    starts: I64
    placed: F64
    errors: F64
    piece_of: I64
    lines: F64
    residuals: F64
    weights: F64
    roughness: float
    bends: F64


class JointSystem(NamedTuple):
    """H x = −g of the poses, H = diagonal − B Bᵀ.

    Attributes:
        diagonal: (k, 3, 3) tangent space at each pose, the lines known.
        gradient: (k, 3).
        pose_of: (n,) pose of each block of B, increasing …
        line_of: (n,) … and its line.
        blocks: (n, 3, 2) the blocks.
    """

    diagonal: F64
    gradient: F64
    pose_of: I64
    line_of: I64
    blocks: F64


@compiled
def normal_equations(poses: F64, seen: PointsOnLines) -> JointSystem:
    """½ Σ w r² linearised in the (k, 3) poses, T_map_robot, the lines eliminated."""
    n, m, k = len(seen.placed), len(seen.lines), len(poses)
    room = JointSystem(
        np.zeros((k, 3, 3)), np.zeros((k, 3)), np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 3, 2))
    )
    hll, gl, last = np.zeros((m, 3)), np.zeros((m, 2)), np.full(m, -1)
    count = ZERO
    for key in range(k):
        count = _add_pose(key, poses[key], seen, room, count, last, hll, gl)
    _factorize_lines(hll, gl)
    _eliminate_lines(room, count, hll, gl)
    return JointSystem(room.diagonal, room.gradient, room.pose_of[:count], room.line_of[:count], room.blocks[:count])


@compiled
def _add_pose(
    key: int, pose: F64, seen: PointsOnLines, system: JointSystem, count: int, last: I64, hll: F64, gl: F64
) -> int:
    """Add the points of one pose: its own terms, its block with each line, and the terms of the lines.

    Derivatives are with respect to a step of the robot in its own frame, and of the line: offset and turn. They are
    those at the foot of the point: where along its beam it most probably was, for its error along the wall, by which
    it would turn robot and line, comes with that across.

    Args:
        key: index of the pose.
        pose: (3,) T_map_robot.
        seen: the points.
        system: changed in place, its blocks without the lines' factors yet.
        count: blocks so far.
        last: (m,) newest block of each line, changed in place.
        hll: (m, 3) Hessian of each line, changed in place …
        gl: (m, 2) … and its gradient.

    Returns:
        The number of blocks.
    """
    placed, lines = seen.placed, seen.lines
    blocks, d, first = system.blocks, system.diagonal[key], count
    c, s = cos(pose[2]), sin(pose[2])
    g0, g1, g2 = 0.0, 0.0, 0.0
    for i in range(seen.starts[key], seen.starts[key + 1]):
        g = seen.piece_of[i]
        if g < 0:
            continue
        q = last[g]
        if q < first:
            q = last[g] = count
            system.pose_of[q], system.line_of[q] = key, g
            blocks[q] = 0.0
            count += 1
        w, r, mx, my = seen.weights[i], seen.residuals[i], lines[g, 2], lines[g, 3]
        ex, ey = seen.errors[i, 0], seen.errors[i, 1]
        across = mx * ex + my * ey
        share = r * across / (across * across + seen.roughness * seen.roughness)
        px, py = placed[i, 0] - share * ex, placed[i, 1] - share * ey
        t = mx * (py - lines[g, 1]) - my * (px - lines[g, 0])
        turned = seen.bends[g, 0] + seen.bends[g, 1] * t
        nx, ny = mx - turned * my, my + turned * mx
        jx, jy = c * nx + s * ny, c * ny - s * nx
        jt = ny * (px - pose[0]) - nx * (py - pose[1])
        wx, wy, wt = w * jx, w * jy, w * jt
        d[0, 0] += wx * jx
        d[0, 1] += wx * jy
        d[0, 2] += wx * jt
        d[1, 1] += wy * jy
        d[1, 2] += wy * jt
        d[2, 2] += wt * jt
        g0, g1, g2 = g0 + w * r * jx, g1 + w * r * jy, g2 + w * r * jt
        blocks[q, 0, 0] -= wx
        blocks[q, 1, 0] -= wy
        blocks[q, 2, 0] -= wt
        blocks[q, 0, 1] -= wx * t
        blocks[q, 1, 1] -= wy * t
        blocks[q, 2, 1] -= wt * t
        hll[g, 0] += w
        hll[g, 1] += w * t
        hll[g, 2] += w * t * t
        gl[g, 0] -= w * r
        gl[g, 1] -= w * r * t
    d[1, 0], d[2, 0], d[2, 1] = d[0, 1], d[0, 2], d[1, 2]
    system.gradient[key, 0], system.gradient[key, 1], system.gradient[key, 2] = g0, g1, g2
    return count


@compiled
def _factorize_lines(hll: F64, gl: F64) -> None:
    """Hessians of lines become their Cholesky factors L (l00, l10, l11), gradients L⁻¹ g."""
    for g in range(len(hll)):
        l00 = sqrt(hll[g, 0] + _LOOSE)
        l10 = hll[g, 1] / l00
        l11 = sqrt(hll[g, 2] + _LOOSE * (_PRIOR_LENGTH * _PRIOR_LENGTH) - l10 * l10)
        hll[g, 0], hll[g, 1], hll[g, 2] = l00, l10, l11
        gl[g, 0] /= l00
        gl[g, 1] = (gl[g, 1] - l10 * gl[g, 0]) / l11


@compiled
def _eliminate_lines(system: JointSystem, count: int, factors: F64, gl: F64) -> None:
    """Blocks become those of B = blocks · L⁻ᵀ, and the gradient that without the lines."""
    blocks, gradient = system.blocks, system.gradient
    for q in range(count):
        k, g = system.pose_of[q], system.line_of[q]
        for a in range(3):
            blocks[q, a, 0] /= factors[g, 0]
            blocks[q, a, 1] = (blocks[q, a, 1] - factors[g, 1] * blocks[q, a, 0]) / factors[g, 2]
            gradient[k, a] -= blocks[q, a, 0] * gl[g, 0] + blocks[q, a, 1] * gl[g, 1]


@compiled
def product(system: JointSystem, n_lines: int, x: F64) -> F64:
    """(k, 3) H x."""
    diagonal, pose_of, line_of = system.diagonal, system.pose_of, system.line_of
    y = np.empty(x.shape)
    for k in range(len(x)):
        for a in range(3):
            y[k, a] = diagonal[k, a, 0] * x[k, 0] + diagonal[k, a, 1] * x[k, 1] + diagonal[k, a, 2] * x[k, 2]
    pulled = np.zeros((n_lines, 2))
    for q in range(len(pose_of)):
        k, b, p = pose_of[q], system.blocks[q], pulled[line_of[q]]
        p[0] += b[0, 0] * x[k, 0] + b[1, 0] * x[k, 1] + b[2, 0] * x[k, 2]
        p[1] += b[0, 1] * x[k, 0] + b[1, 1] * x[k, 1] + b[2, 1] * x[k, 2]
    for q in range(len(pose_of)):
        k, b, p = pose_of[q], system.blocks[q], pulled[line_of[q]]
        for a in range(3):
            y[k, a] -= b[a, 0] * p[0] + b[a, 1] * p[1]
    return y


@compiled
def fill(system: JointSystem, matrix: F64) -> None:
    """The same system as a (3k, 3k) matrix, zeros before; its blocks sorted by line, and those of a line by pose."""
    diagonal, pose_of, line_of, blocks = system.diagonal, system.pose_of, system.line_of, system.blocks
    for k in range(len(diagonal)):
        for a in range(3):
            for b in range(3):
                matrix[3 * k + a, 3 * k + b] += diagonal[k, a, b]
    first = 0
    for q in range(len(pose_of)):
        if line_of[q] != line_of[first]:
            first = q
        i = 3 * pose_of[q]
        for a in range(3):
            u, v, row = blocks[q, a, 0], blocks[q, a, 1], matrix[i + a]
            for p in range(first, q):
                j = 3 * pose_of[p]
                row[j] -= u * blocks[p, 0, 0] + v * blocks[p, 0, 1]
                row[j + 1] -= u * blocks[p, 1, 0] + v * blocks[p, 1, 1]
                row[j + 2] -= u * blocks[p, 2, 0] + v * blocks[p, 2, 1]
            for b in range(3):
                row[i + b] -= u * blocks[q, b, 0] + v * blocks[q, b, 1]
    # Poses of a line stand in order, so that only what is below the diagonal was filled.
    for i in range(3, len(matrix), 3):
        for j in range(0, i, 3):
            for a in range(3):
                for b in range(3):
                    matrix[j + b, i + a] = matrix[i + a, j + b]
