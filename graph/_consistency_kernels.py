"""Pairwise consistency of loop closures and cliques among them, compiled."""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@compiled
def _solve_symmetric(s: Floats, e0: float, e1: float, e2: float) -> float:
    """Mahalanobis square eᵀ S⁻¹ e of a positive definite 3×3 matrix; infinite if it is none."""
    if not s[0, 0] > 0.0:
        return np.inf
    l10, l20 = s[1, 0] / s[0, 0], s[2, 0] / s[0, 0]
    d1 = s[1, 1] - l10 * s[1, 0]
    if not d1 > 0.0:
        return np.inf
    l21 = (s[2, 1] - l20 * s[1, 0]) / d1
    d2 = s[2, 2] - l20 * s[2, 0] - l21 * l21 * d1
    if not d2 > 0.0:
        return np.inf
    y1 = e1 - l10 * e0
    y2 = e2 - l20 * e0 - l21 * y1
    return float(e0 * e0 / s[0, 0] + y1 * y1 / d1 + y2 * y2 / d2)


@compiled
def consistent_pairs(
    i: Ints, j: Ints, loops: Floats, loop_covariances: Floats, cumulative: Floats, gate: float
) -> Bools:
    """(m, m) whether the cycle through closures a and b returns to where it began, within the χ² gate.

    Args:
        i: (m,) first pose of each closure.
        j: (m,) second pose.
        loops: (m, 3) E = X_i T_i_j X_j⁻¹, the error of each closure against the chain, seen in the map.
        loop_covariances: (m, 3, 3) of each closure's own error, perturbing E from the left.
        cumulative: (n, 3, 3) covariance of each pose of the chain, perturbing it from the left.
        gate: largest squared norm.
    """
    m = len(i)
    consistent = np.empty((m, m), np.bool_)
    consistent[:] = True
    s, chain, moved = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    carry = np.zeros((3, 3))
    carry[2, 2] = 1.0
    for a in range(m):
        ca, sa = np.cos(loops[a, 2]), np.sin(loops[a, 2])
        carry[0, 0], carry[0, 1], carry[0, 2] = ca, -sa, loops[a, 1]
        carry[1, 0], carry[1, 1], carry[1, 2] = sa, ca, -loops[a, 0]
        for b in range(a + 1, m):
            turn = loops[a, 2] - loops[b, 2]
            turn -= 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))
            c, sn = np.cos(turn), np.sin(turn)  # E_a · E_b⁻¹
            x = loops[a, 0] - (c * loops[b, 0] - sn * loops[b, 1])
            y = loops[a, 1] - (sn * loops[b, 0] + c * loops[b, 1])
            half = 0.5 * turn
            cotangent = 1.0 - turn * turn / 12.0 if abs(turn) < 1e-4 else half / np.tan(half)
            e0, e1 = cotangent * x + half * y, cotangent * y - half * x
            early, late = min(i[a], i[b]), max(i[a], i[b])
            first, last = min(j[a], j[b]), max(j[a], j[b])
            for r in range(3):
                for k in range(3):
                    chain[r, k] = cumulative[last, r, k] - cumulative[first, r, k]
            for r in range(3):
                for k in range(3):
                    moved[r, k] = carry[r, 0] * chain[0, k] + carry[r, 1] * chain[1, k] + carry[r, 2] * chain[2, k]
            for r in range(3):
                for k in range(3):
                    s[r, k] = (
                        moved[r, 0] * carry[k, 0]
                        + moved[r, 1] * carry[k, 1]
                        + moved[r, 2] * carry[k, 2]
                        + loop_covariances[a, r, k]
                        + loop_covariances[b, r, k]
                        + cumulative[late, r, k]
                        - cumulative[early, r, k]
                    )
            fits = _solve_symmetric(s, e0, e1, turn) <= gate
            consistent[a, b] = fits
            consistent[b, a] = fits
    return consistent


@compiled
def greedy_clique(consistent: Bools) -> Bools:
    """(m,) members of a large clique: who has most conflicts leaves until none is left, then who fits returns."""
    m = len(consistent)
    member = np.empty(m, np.bool_)
    member[:] = True
    conflicts = np.zeros(m, dtype=np.int64)
    for a in range(m):
        for b in range(m):
            if not consistent[a, b]:
                conflicts[a] += 1
    while True:
        worst = -1
        for a in range(m):
            if member[a] and conflicts[a] > 0 and (worst < 0 or conflicts[a] >= conflicts[worst]):
                worst = a
        if worst < 0:
            break
        member[worst] = False
        for b in range(m):
            if not consistent[worst, b]:
                conflicts[b] -= 1
    for a in range(m):
        if not member[a] and conflicts[a] == 0:
            member[a] = True
            for b in range(m):
                if not consistent[a, b]:
                    conflicts[b] += 1
    return member
