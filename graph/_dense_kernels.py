"""Small dense algebra, compiled: every sum in one fixed order, so that every processor finds the same digits."""

import math

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both

Floats = NDArray[np.float64]


@compiled
def multiply(a: Floats, b: Floats, out: Floats) -> None:
    """Add a · b to `out`: (n or 1, i, k), (n or 1, k, j) and (n, i, j)."""
    for n in range(len(out)):
        left, right = a[n if len(a) > 1 else 0], b[n if len(b) > 1 else 0]
        fours = left.shape[1] // 4 * 4
        for i in range(left.shape[0]):
            for k in range(0, fours, 4):
                _add_four(left[i, k : k + 4], right[k : k + 4], out[n, i])
            for k in range(fours, left.shape[1]):
                factor = left[i, k]
                for j in range(right.shape[1]):
                    out[n, i, j] += factor * right[k, j]


@compiled
def _add_four(factors: Floats, rows: Floats, out: Floats) -> None:
    """Add four rows, each times its factor, to a row, in their order: one way through it instead of four."""
    a, b, c, d = factors[0], factors[1], factors[2], factors[3]
    first, second, third, fourth = rows[0], rows[1], rows[2], rows[3]
    for j in range(len(out)):
        out[j] = (((out[j] + a * first[j]) + b * second[j]) + c * third[j]) + d * fourth[j]


@compiled
def congruence(a: Floats, s: Floats, out: Floats) -> None:
    """Put a · s · aᵀ into `out`: (n or 1, i, k), (n or 1, k, k) and (n, i, i)."""
    rows, size = a.shape[1], a.shape[2]
    moved = np.empty(size)
    for n in range(len(out)):
        left, middle = a[n if len(a) > 1 else 0], s[n if len(s) > 1 else 0]
        for i in range(rows):
            for j in range(size):
                value = 0.0
                for k in range(size):
                    value += left[i, k] * middle[k, j]
                moved[j] = value
            for j in range(rows):
                value = 0.0
                for k in range(size):
                    value += moved[k] * left[j, k]
                out[n, i, j] = value


@compiled
def factorize(matrices: Floats) -> bool:
    """Put Cholesky's lower triangles in the place of (n, k, k) matrices; False where one is not positive definite."""
    n, size = matrices.shape[0], matrices.shape[1]
    for m in range(n):
        root = matrices[m]
        for j in range(size):
            left = root[j, j]
            for k in range(j):
                left -= root[j, k] * root[j, k]
            if not left > 0.0:
                return False
            root[j, j] = math.sqrt(left)
            for i in range(j + 1, size):
                value = root[i, j]
                for k in range(j):
                    value -= root[i, k] * root[j, k]
                root[i, j] = value / root[j, j]
            for i in range(j):
                root[i, j] = 0.0
    return True


@compiled_for_both
def solve(matrices: Floats, right: Floats) -> bool:
    """Put the solutions of A x = b in the place of (n, k, m) b, by elimination with row pivots; spoils (n, k, k) A.

    Returns:
        False where a matrix is singular to the last digit.
    """
    for n in range(len(matrices)):
        a, b = matrices[n], right[n]
        if not _eliminate(a, b):
            return False
        for j in range(len(a) - 1, -1, -1):
            for k in range(b.shape[1]):
                value = b[j, k]
                for i in range(j + 1, len(a)):
                    value -= a[j, i] * b[i, k]
                b[j, k] = value / a[j, j]
    return True


@compiled
def _eliminate(a: Floats, b: Floats) -> bool:
    """Bring (k, k) a to an upper triangle, and (k, m) b along; False where a is singular."""
    size = len(a)
    for j in range(size):
        pivot = j
        for i in range(j + 1, size):
            if abs(a[i, j]) > abs(a[pivot, j]):
                pivot = i
        if not abs(a[pivot, j]) > 0.0:
            return False
        if pivot != j:
            for k in range(size):
                a[j, k], a[pivot, k] = a[pivot, k], a[j, k]
            for k in range(b.shape[1]):
                b[j, k], b[pivot, k] = b[pivot, k], b[j, k]
        for i in range(j + 1, size):
            factor = a[i, j] / a[j, j]
            for k in range(j + 1, size):
                a[i, k] -= factor * a[j, k]
            for k in range(b.shape[1]):
                b[i, k] -= factor * b[j, k]
    return True


@compiled
def _solve_one(matrix: Floats, right: Floats, x: Floats) -> bool:
    """Put the solution of A x = b in (k,) `x`; spoils (k, k) A, keeps (k,) b; False where A is singular."""
    for k in range(len(right)):
        x[k] = right[k]
    return solve(matrix.reshape((1, len(x), len(x))), x.reshape((1, len(x), 1)))


@compiled
def diagonalize(matrices: Floats, axes: Floats) -> None:
    """Rotate (n, k, k) symmetric matrices until they are diagonal, and (n, k, k) unit matrices with them (Jacobi)."""
    size = matrices.shape[1]
    for n in range(len(matrices)):
        a, v = matrices[n], axes[n]
        for _ in range(60):
            beside, along = 0.0, 0.0
            for i in range(size):
                along += a[i, i] * a[i, i]
                for j in range(i):
                    beside += a[i, j] * a[i, j]
            if not beside > 1e-34 * along:
                break
            for p in range(size - 1):
                for q in range(p + 1, size):
                    _rotate(a, v, p, q)


@compiled
def _rotate(a: Floats, v: Floats, p: int, q: int) -> None:
    """Make a[p, q] zero, rotating the axes v along (Golub and Van Loan, algorithm 8.5.1)."""
    if a[p, q] == 0.0:
        return
    tau = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
    t = 1.0 / (abs(tau) + math.sqrt(1.0 + tau * tau))
    if tau < 0.0:
        t = -t
    c = 1.0 / math.sqrt(1.0 + t * t)
    s = t * c
    app, aqq, apq = a[p, p], a[q, q], a[p, q]
    for k in range(a.shape[0]):
        akp, akq = a[k, p], a[k, q]
        a[k, p], a[k, q] = c * akp - s * akq, s * akp + c * akq
        a[p, k], a[q, k] = a[k, p], a[k, q]
        vkp, vkq = v[k, p], v[k, q]
        v[k, p], v[k, q] = c * vkp - s * vkq, s * vkp + c * vkq
    a[p, p], a[q, q] = app - t * apq, aqq + t * apq
    a[p, q] = a[q, p] = 0.0
