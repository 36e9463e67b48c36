"""Residuals of relative poses and the normal equations of one step, compiled."""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@compiled
def _wrapped(angle: float) -> float:
    return float(angle - 2.0 * np.pi * np.rint(angle / (2.0 * np.pi)))


@compiled
def residuals(poses: Floats, i: Ints, j: Ints, measured: Floats) -> Floats:
    """(m, 3) logarithms of T_measured⁻¹ · T_i⁻¹ · T_j; i = −1 stands for the map itself."""
    out = np.empty((len(j), 3))
    for m in range(len(j)):
        x, y, heading = poses[j[m], 0], poses[j[m], 1], poses[j[m], 2]
        if i[m] >= 0:
            first = poses[i[m]]
            c, s = np.cos(first[2]), np.sin(first[2])
            dx, dy = x - first[0], y - first[1]
            x, y, heading = c * dx + s * dy, c * dy - s * dx, heading - first[2]
        c, s = np.cos(measured[m, 2]), np.sin(measured[m, 2])
        dx, dy = x - measured[m, 0], y - measured[m, 1]
        x, y, theta = c * dx + s * dy, c * dy - s * dx, _wrapped(heading - measured[m, 2])
        half = 0.5 * theta
        cotangent = 1.0 - theta * theta / 12.0 if abs(theta) < 1e-4 else half / np.tan(half)
        out[m, 0], out[m, 1], out[m, 2] = cotangent * x + half * y, cotangent * y - half * x, theta
    return out


@compiled
def _pulled_back(information: Floats, e: Floats, weight: float, out: Floats) -> tuple[float, float, float]:
    """Write w MᵀΩM into `out` and return w MᵀΩe, M = Jr⁻¹(e) the derivative of the logarithm."""
    half = 0.5 * e[2]
    if abs(e[2]) < 1e-4:
        cotangent, bend = 1.0 - e[2] * e[2] / 12.0, e[2] / 12.0
    else:
        cotangent = half / np.tan(half)
        bend = (1.0 - cotangent) / e[2]
    p, q = bend * e[0] + 0.5 * e[1], bend * e[1] - 0.5 * e[0]  # M = [[cot, −½θ, p], [½θ, cot, q], [0, 0, 1]]
    o00, o01, o02 = weight * information[0, 0], weight * information[0, 1], weight * information[0, 2]
    o11, o12, o22 = weight * information[1, 1], weight * information[1, 2], weight * information[2, 2]
    a00, a01 = o00 * cotangent + o01 * half, o01 * cotangent - o00 * half
    a10, a11 = o01 * cotangent + o11 * half, o11 * cotangent - o01 * half
    a02, a12, a22 = o00 * p + o01 * q + o02, o01 * p + o11 * q + o12, o02 * p + o12 * q + o22
    out[0, 0], out[0, 1] = cotangent * a00 + half * a10, cotangent * a01 + half * a11
    out[1, 0], out[1, 1] = out[0, 1], cotangent * a11 - half * a01
    out[0, 2], out[1, 2] = cotangent * a02 + half * a12, cotangent * a12 - half * a02
    out[2, 0], out[2, 1] = out[0, 2], out[1, 2]
    out[2, 2] = p * a02 + q * a12 + a22
    g0 = o00 * e[0] + o01 * e[1] + o02 * e[2]
    g1 = o01 * e[0] + o11 * e[1] + o12 * e[2]
    g2 = o02 * e[0] + o12 * e[1] + o22 * e[2]
    return cotangent * g0 + half * g1, cotangent * g1 - half * g0, p * g0 + q * g1 + g2


@compiled
def _first_jacobian(first: Floats, second: Floats, out: Floats) -> None:
    """Write −Ad(T_j⁻¹ T_i) into `out`, what is left of Jᵢ with Jⱼ = Jr⁻¹ inside Ω; its last row is 0, 0, −1."""
    turn = first[2] - second[2]
    cj, sj = np.cos(second[2]), np.sin(second[2])
    dx, dy = first[0] - second[0], first[1] - second[1]
    ct, st = np.cos(turn), np.sin(turn)
    out[0, 0], out[0, 1], out[0, 2] = -ct, st, -(cj * dy - sj * dx)
    out[1, 0], out[1, 1], out[1, 2] = -st, -ct, cj * dx + sj * dy
    out[2, 0], out[2, 1], out[2, 2] = 0.0, 0.0, -1.0


@compiled
def normal_equations(
    poses: Floats,
    i: Ints,
    j: Ints,
    errors: Floats,
    information: Floats,
    weight: Floats,
    row_of: Ints,
    slot: Ints,
    diagonal: Floats,
    upper: Floats,
    gradient: Floats,
) -> None:
    """H = Σ w Jᵀ Ω J and g = Σ w Jᵀ Ω e, added into zeroed blocks.

    Args:
        poses: (n, 3).
        i: (m,) first pose of each factor, −1 for the map.
        j: (m,) second pose.
        errors: (m, 3) residuals.
        information: (m, 3, 3).
        weight: (m,).
        row_of: (n,) place of each pose in the order of elimination.
        slot: (m,) place of each factor's off-diagonal block in `upper`, whose rows come before its columns.
        diagonal: (n, 3, 3) in the order of elimination, changed in place.
        upper: (k, 3, 3), changed in place.
        gradient: (n, 3) in the order of elimination, changed in place.
    """
    wj = np.zeros((3, 3))  # Ω Jᵢ
    first = np.zeros((3, 3))
    o = np.zeros((3, 3))
    for m in range(len(j)):
        w = weight[m]
        if w == 0.0:
            continue
        e, b = errors[m], row_of[j[m]]
        oe0, oe1, oe2 = _pulled_back(information[m], e, w, o)
        gradient[b, 0] += oe0
        gradient[b, 1] += oe1
        gradient[b, 2] += oe2
        for r in range(3):
            for c in range(3):
                diagonal[b, r, c] += o[r, c]
        if i[m] < 0:
            continue
        a = row_of[i[m]]
        _first_jacobian(poses[i[m]], poses[j[m]], first)
        for r in range(3):
            for c in range(3):
                wj[r, c] = o[r, 0] * first[0, c] + o[r, 1] * first[1, c] + o[r, 2] * first[2, c]
        p = slot[m]
        for r in range(3):
            gradient[a, r] += first[0, r] * oe0 + first[1, r] * oe1 + first[2, r] * oe2
            for c in range(3):
                diagonal[a, r, c] += first[0, r] * wj[0, c] + first[1, r] * wj[1, c] + first[2, r] * wj[2, c]
                if a < b:
                    upper[p, c, r] += wj[r, c]
                else:
                    upper[p, r, c] += wj[r, c]
