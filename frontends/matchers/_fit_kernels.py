"""Rigid motions that bring pairs together in closed form, and steps from one pose to the next, compiled."""

import math

import numpy as np
from numpy.typing import NDArray

from graph._dense_kernels import solve
from graph.compiled import compiled, compiled_for_both


@compiled_for_both
def line_fit(
    moved: NDArray[np.float64],
    targets: NDArray[np.float64],
    normals: NDArray[np.float64],
    kept: NDArray[np.bool_],
    damping: float,
) -> tuple[float, float, float]:
    """The motion (x, y, angle) that minimises Σ (nᵀ(R p + t − q))² exactly.

    Linear in (t, cos, sin) under cos² + sin² = 1: t is eliminated, and the Lagrange multiplier of the constraint is the
    root of a decreasing function. Damping pulls t to 0 where the normals leave it free.
    """
    A = np.zeros((2, 2))
    B = np.zeros((2, 2))
    D = np.zeros((2, 2))
    at, az = np.zeros(2), np.zeros(2)
    count = 0
    for i in range(len(moved)):
        if not kept[i]:
            continue
        count += 1
        px, py = moved[i]
        nx, ny = normals[i]
        d = nx * targets[i, 0] + ny * targets[i, 1]
        c, s = nx * px + ny * py, ny * px - nx * py
        A[0, 0] += nx * nx
        A[0, 1] += nx * ny
        A[1, 1] += ny * ny
        B[0, 0] += nx * c
        B[0, 1] += nx * s
        B[1, 0] += ny * c
        B[1, 1] += ny * s
        D[0, 0] += c * c
        D[0, 1] += c * s
        D[1, 1] += s * s
        at[0] += nx * d
        at[1] += ny * d
        az[0] += c * d
        az[1] += s * d
    A[0, 0] += damping * count
    A[1, 1] += damping * count
    A[1, 0], D[1, 0] = A[0, 1], D[0, 1]
    right = np.empty((1, 2, 3))  # A⁻¹ (B | at)
    right[0, :, :2], right[0, :, 2] = B, at
    solve(A.reshape((1, 2, 2)).copy(), right)
    solved = right[0]
    S, h = D.copy(), -az
    for i in range(2):
        for k in range(2):
            h[i] += B[k, i] * solved[k, 2]
            for j in range(2):
                S[i, j] -= B[k, i] * solved[k, j]
    angle = _unit_minimum(S, h)
    c, s = math.cos(angle), math.sin(angle)
    x, y = solved[:, 2] - c * solved[:, 0] - s * solved[:, 1]
    return x, y, angle


@compiled_for_both
def rigid_fit(
    points: NDArray[np.float64], targets: NDArray[np.float64], kept: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """The pose that takes the kept points nearest to their targets, in closed form."""
    n, px, py, qx, qy = 0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(points)):
        if kept[i]:
            n += 1
            px += points[i, 0]
            py += points[i, 1]
            qx += targets[i, 0]
            qy += targets[i, 1]
    px, py, qx, qy = px / n, py / n, qx / n, qy / n
    dot, cross = 0.0, 0.0
    for i in range(len(points)):
        if kept[i]:
            ax, ay = points[i, 0] - px, points[i, 1] - py
            bx, by = targets[i, 0] - qx, targets[i, 1] - qy
            dot += ax * bx + ay * by
            cross += ax * by - ay * bx
    angle = math.atan2(cross, dot)
    c, s = math.cos(angle), math.sin(angle)
    return qx - c * px + s * py, qy - s * px - c * py, angle


@compiled_for_both
def metric_normal_equations(
    moved: NDArray[np.float64], targets: NDArray[np.float64], kept: NDArray[np.bool_], length2: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """H and g of the step x that minimises Σ δᵀWδ, δ = q − p − Jx, W = I − kkᵀ/(|p|² + L²), k = (p_y, −p_x)."""
    H, g = np.zeros((3, 3)), np.zeros(3)
    for i in range(len(moved)):
        if not kept[i]:
            continue
        x, y = moved[i]
        dx, dy = targets[i, 0] - x, targets[i, 1] - y
        r2 = x * x + y * y
        k = 1.0 / (r2 + length2)
        turn = dx * y - dy * x
        # The columns of J are e₁, e₂ and (−y, x); J₃ᵀk = −|p|².
        H[0, 0] += 1.0 - k * y * y
        H[0, 1] += k * x * y
        H[1, 1] += 1.0 - k * x * x
        H[0, 2] -= y - k * r2 * y
        H[1, 2] += x - k * r2 * x
        H[2, 2] += r2 - k * r2 * r2
        g[0] += dx - k * turn * y
        g[1] += dy + k * turn * x
        g[2] += -turn + k * turn * r2
    H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]
    return H, g


@compiled
def _unit_minimum(S: NDArray[np.float64], h: NDArray[np.float64]) -> float:
    """Angle of the unit vector z that minimises zᵀSz + 2hᵀz: (S + λI)z = −h with the largest λ that makes |z| = 1."""
    half, off = 0.5 * (S[0, 0] - S[1, 1]), S[0, 1]
    radius = math.hypot(half, off)
    axis = 0.5 * math.atan2(off, half)
    c, s = math.cos(axis), math.sin(axis)
    high, low = c * h[0] + s * h[1], c * h[1] - s * h[0]  # h along the eigenvectors of mean ± radius
    # With λ measured from −(mean − radius): low²/λ² + high²/(λ + 2 radius)² = 1 has one root in (0, |h|].
    below, above = abs(low), math.hypot(low, high)
    if above == 0.0:
        return axis + 0.5 * math.pi
    for _ in range(60):
        x = 0.5 * (below + above)
        if (low / x) ** 2 + (high / (x + 2.0 * radius)) ** 2 > 1.0:
            below = x
        else:
            above = x
    along = -high / (above + 2.0 * radius)
    across = math.copysign(math.sqrt(max(0.0, 1.0 - along * along)), -low)
    return math.atan2(s * along + c * across, c * along - s * across)


@compiled_for_both
def move(points: NDArray[np.float64], pose: NDArray[np.float64], moved: NDArray[np.float64]) -> None:
    """Place (n, 2) points at a pose, into `moved`, which the descent fills anew at every step."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(len(points)):
        px, py = points[i]
        moved[i, 0] = pose[0] + c * px - s * py
        moved[i, 1] = pose[1] + s * px + c * py


@compiled_for_both
def composed(x: float, y: float, angle: float, pose: NDArray[np.float64]) -> tuple[float, float, float]:
    """A motion in the reference frame after the pose so far."""
    c, s = math.cos(angle), math.sin(angle)
    return x + c * pose[0] - s * pose[1], y + s * pose[0] + c * pose[1], pose[2] + angle


@compiled_for_both
def take(fit: tuple[float, float, float], pose: NDArray[np.float64], epsilon: float) -> bool:
    """Make the fit the pose; true when it moved by less than `epsilon` in metres and radians."""
    turn = (fit[2] - pose[2] + math.pi) % (2.0 * math.pi) - math.pi
    step = math.hypot(fit[0] - pose[0], fit[1] - pose[1])
    pose[0], pose[1] = fit[0], fit[1]
    pose[2] = (fit[2] + math.pi) % (2.0 * math.pi) - math.pi
    return step < epsilon and abs(turn) < epsilon
