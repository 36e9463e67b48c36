"""Sparse Cholesky factors of symmetric matrices of 3×3 blocks, compiled: structure, numbers, solution, inverse.

L is stored by columns: column j holds its diagonal block apart (`diagonal[j]`, lower triangular) and the blocks
below it in `values[starts[j]:starts[j + 1]]`, their rows increasing. Davis, Direct Methods for
Sparse Linear Systems (2006).
"""

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph._sort_kernels import _sort
from graph.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@compiled
def multiplied(column_starts: Ints, rows: Ints, upper: Floats, diagonal: Floats, x: Floats) -> Floats:
    """(n, 3) product of the symmetric matrix with these strictly upper blocks and diagonal, and x."""
    y = np.zeros(x.shape)
    for k in range(len(diagonal)):
        for a in range(3):
            for b in range(3):
                y[k, a] += diagonal[k, a, b] * x[k, b]
        for p in range(column_starts[k], column_starts[k + 1]):
            i = rows[p]
            for a in range(3):
                for b in range(3):
                    y[i, a] += upper[p, a, b] * x[k, b]
                    y[k, b] += upper[p, a, b] * x[i, a]
    return y


@compiled
def factor_structure(n: int, column_starts: Ints, rows: Ints) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Where L has blocks: its columns, and the same by rows with the place of each block.

    Args:
        n: number of block columns.
        column_starts: (n + 1,) of the strictly upper blocks of the matrix.
        rows: row of each of them.

    Returns:
        starts (n + 1,) and rows of L's columns; starts (n + 1,), columns and places in `values` of L's rows.
    """
    parent = np.full(n, -1)
    seen = np.full(n, -1)
    counts = np.zeros(n, dtype=np.int64)
    row_starts = np.zeros(n + 1, dtype=np.int64)
    for k in range(n):
        seen[k] = k
        for p in range(column_starts[k], column_starts[k + 1]):
            i = rows[p]
            while seen[i] != k:
                if parent[i] == -1:
                    parent[i] = k
                seen[i] = k
                counts[i] += 1
                row_starts[k + 1] += 1
                i = parent[i]
    starts = np.zeros(n + 1, dtype=np.int64)
    for k in range(n):
        starts[k + 1] = starts[k] + counts[k]
        row_starts[k + 1] += row_starts[k]
    filled = starts[:-1].copy()
    rows_of_l = np.zeros(starts[n], dtype=np.int64)
    columns_of_l = np.zeros(starts[n], dtype=np.int64)
    places = np.zeros(starts[n], dtype=np.int64)
    seen[:] = -1
    for k in range(n):
        seen[k] = k
        count = row_starts[k]
        for p in range(column_starts[k], column_starts[k + 1]):
            i = rows[p]
            while seen[i] != k:
                seen[i] = k
                columns_of_l[count] = i
                count += 1
                i = parent[i]
        _sort(columns_of_l[row_starts[k] : count])  # a column comes after those it hangs on
        for p in range(row_starts[k], count):
            i = columns_of_l[p]
            rows_of_l[filled[i]] = k
            places[p] = filled[i]
            filled[i] += 1
    return starts, rows_of_l, row_starts, columns_of_l, places


@compiled
def _factor_diagonal(a: Floats, out: Floats) -> bool:
    """Lower triangular root of one 3×3 block; False when it is not positive definite."""
    if not a[0, 0] > 0.0:
        return False
    l00 = np.sqrt(a[0, 0])
    l10, l20 = a[1, 0] / l00, a[2, 0] / l00
    d1 = a[1, 1] - l10 * l10
    if not d1 > 0.0:
        return False
    l11 = np.sqrt(d1)
    l21 = (a[2, 1] - l20 * l10) / l11
    d2 = a[2, 2] - l20 * l20 - l21 * l21
    if not d2 > 0.0:
        return False
    out[0, 0], out[1, 0], out[1, 1] = l00, l10, l11
    out[2, 0], out[2, 1], out[2, 2] = l20, l21, np.sqrt(d2)
    return True


@compiled
def _divided(x: Floats, d: Floats) -> tuple[float, float, float, float, float, float, float, float, float]:
    """M of m dᵀ = x, row after row, for a lower triangular 3×3 block d."""
    m00, m10, m20 = x[0, 0] / d[0, 0], x[1, 0] / d[0, 0], x[2, 0] / d[0, 0]
    m01, m11, m21 = (
        (x[0, 1] - m00 * d[1, 0]) / d[1, 1],
        (x[1, 1] - m10 * d[1, 0]) / d[1, 1],
        (x[2, 1] - m20 * d[1, 0]) / d[1, 1],
    )
    m02 = (x[0, 2] - m00 * d[2, 0] - m01 * d[2, 1]) / d[2, 2]
    m12 = (x[1, 2] - m10 * d[2, 0] - m11 * d[2, 1]) / d[2, 2]
    m22 = (x[2, 2] - m20 * d[2, 0] - m21 * d[2, 1]) / d[2, 2]
    return m00, m01, m02, m10, m11, m12, m20, m21, m22


@compiled
def factorize(
    column_starts: Ints,
    rows: Ints,
    upper: Floats,
    diagonal_in: Floats,
    starts: Ints,
    rows_of_l: Ints,
    row_starts: Ints,
    columns_of_l: Ints,
    places: Ints,
    values: Floats,
    diagonal: Floats,
) -> bool:
    """L of the matrix with these strictly upper blocks and diagonal, row after row; False if not positive definite."""
    n = len(diagonal_in)
    x = np.zeros((n, 3, 3))  # row k of L as it comes about: x[i] = A_ki − Σ L_kj L_ijᵀ
    pivot = np.zeros((3, 3))
    for k in range(n):
        for p in range(column_starts[k], column_starts[k + 1]):
            i = rows[p]
            for a in range(3):
                for b in range(3):
                    x[i, a, b] = upper[p, b, a]
        assign(pivot, diagonal_in[k])
        for p in range(row_starts[k], row_starts[k + 1]):
            i = columns_of_l[p]
            m00, m01, m02, m10, m11, m12, m20, m21, m22 = _divided(x[i], diagonal[i])
            x[i] = 0.0
            place = places[p]
            for q in range(starts[i], place):
                r = rows_of_l[q]
                v00, v01, v02 = values[q, 0, 0], values[q, 0, 1], values[q, 0, 2]
                v10, v11, v12 = values[q, 1, 0], values[q, 1, 1], values[q, 1, 2]
                v20, v21, v22 = values[q, 2, 0], values[q, 2, 1], values[q, 2, 2]
                x[r, 0, 0] -= m00 * v00 + m01 * v01 + m02 * v02
                x[r, 0, 1] -= m00 * v10 + m01 * v11 + m02 * v12
                x[r, 0, 2] -= m00 * v20 + m01 * v21 + m02 * v22
                x[r, 1, 0] -= m10 * v00 + m11 * v01 + m12 * v02
                x[r, 1, 1] -= m10 * v10 + m11 * v11 + m12 * v12
                x[r, 1, 2] -= m10 * v20 + m11 * v21 + m12 * v22
                x[r, 2, 0] -= m20 * v00 + m21 * v01 + m22 * v02
                x[r, 2, 1] -= m20 * v10 + m21 * v11 + m22 * v12
                x[r, 2, 2] -= m20 * v20 + m21 * v21 + m22 * v22
            values[place, 0, 0], values[place, 0, 1], values[place, 0, 2] = m00, m01, m02
            values[place, 1, 0], values[place, 1, 1], values[place, 1, 2] = m10, m11, m12
            values[place, 2, 0], values[place, 2, 1], values[place, 2, 2] = m20, m21, m22
            pivot[0, 0] -= m00 * m00 + m01 * m01 + m02 * m02
            pivot[1, 0] -= m10 * m00 + m11 * m01 + m12 * m02
            pivot[1, 1] -= m10 * m10 + m11 * m11 + m12 * m12
            pivot[2, 0] -= m20 * m00 + m21 * m01 + m22 * m02
            pivot[2, 1] -= m20 * m10 + m21 * m11 + m22 * m12
            pivot[2, 2] -= m20 * m20 + m21 * m21 + m22 * m22
        if not _factor_diagonal(pivot, diagonal[k]):
            return False
    return True


@compiled
def solve_factored(starts: Ints, rows_of_l: Ints, values: Floats, diagonal: Floats, right: Floats) -> Floats:
    """Solve L Lᵀ x = right, both (n, 3)."""
    n = len(diagonal)
    x = right.copy()
    for j in range(n):
        d = diagonal[j]
        x[j, 0] /= d[0, 0]
        x[j, 1] = (x[j, 1] - d[1, 0] * x[j, 0]) / d[1, 1]
        x[j, 2] = (x[j, 2] - d[2, 0] * x[j, 0] - d[2, 1] * x[j, 1]) / d[2, 2]
        for q in range(starts[j], starts[j + 1]):
            r = rows_of_l[q]
            for a in range(3):
                x[r, a] -= values[q, a, 0] * x[j, 0] + values[q, a, 1] * x[j, 1] + values[q, a, 2] * x[j, 2]
    for j in range(n - 1, -1, -1):
        for q in range(starts[j], starts[j + 1]):
            r = rows_of_l[q]
            for b in range(3):
                x[j, b] -= values[q, 0, b] * x[r, 0] + values[q, 1, b] * x[r, 1] + values[q, 2, b] * x[r, 2]
        d = diagonal[j]
        x[j, 2] /= d[2, 2]
        x[j, 1] = (x[j, 1] - d[2, 1] * x[j, 2]) / d[1, 1]
        x[j, 0] = (x[j, 0] - d[1, 0] * x[j, 1] - d[2, 0] * x[j, 2]) / d[0, 0]
    return x


@compiled
def selected_inverse(starts: Ints, rows_of_l: Ints, values: Floats, diagonal: Floats) -> tuple[Floats, Floats]:
    """Blocks of (L Lᵀ)⁻¹ where L has blocks, by Takahashi's recursion.

    Returns:
        The strictly lower blocks in the places of `values` and the (n, 3, 3) diagonal.
    """
    n = len(diagonal)
    lower = np.zeros(values.shape)
    on_diagonal = np.zeros(diagonal.shape)
    place_of = np.full(n, -1)
    inverse = np.zeros((3, 3))
    scaled = np.zeros(values.shape)  # L_kj L_jj⁻¹
    for j in range(n - 1, -1, -1):
        d = diagonal[j]
        inverse[0, 0], inverse[1, 1], inverse[2, 2] = 1.0 / d[0, 0], 1.0 / d[1, 1], 1.0 / d[2, 2]
        inverse[1, 0] = -d[1, 0] * inverse[0, 0] * inverse[1, 1]
        inverse[2, 1] = -d[2, 1] * inverse[1, 1] * inverse[2, 2]
        inverse[2, 0] = -(d[2, 0] * inverse[0, 0] + d[2, 1] * inverse[1, 0]) * inverse[2, 2]
        first, last = starts[j], starts[j + 1]
        for q in range(first, last):
            place_of[rows_of_l[q]] = q
            for a in range(3):
                for b in range(3):
                    total = 0.0
                    for c in range(b, 3):
                        total += values[q, a, c] * inverse[c, b]
                    scaled[q, a, b] = total
        for q in range(first, last):  # Z_ij = −Σ_k Z_ik S_kj: column k of Z serves rows i > k, and, turned, row k
            k = rows_of_l[q]
            _subtract_product(lower[q], on_diagonal[k], scaled[q])
            for r in range(starts[k], starts[k + 1]):
                place = place_of[rows_of_l[r]]
                if place >= 0:
                    _subtract_product(lower[place], lower[r], scaled[q])
                    _subtract_turned_product(lower[q], lower[r], scaled[place])
        for a in range(3):
            for b in range(3):
                total = 0.0
                for c in range(max(a, b), 3):
                    total += inverse[c, a] * inverse[c, b]
                for q in range(first, last):
                    for c in range(3):
                        total -= scaled[q, c, a] * lower[q, c, b]
                on_diagonal[j, a, b] = total
        for q in range(first, last):
            place_of[rows_of_l[q]] = -1
    return lower, on_diagonal


@compiled
def _subtract_product(out: Floats, left: Floats, right: Floats) -> None:
    for a in range(3):
        for b in range(3):
            out[a, b] -= left[a, 0] * right[0, b] + left[a, 1] * right[1, b] + left[a, 2] * right[2, b]


@compiled
def _subtract_turned_product(out: Floats, left: Floats, right: Floats) -> None:
    for a in range(3):
        for b in range(3):
            out[a, b] -= left[0, a] * right[0, b] + left[1, a] * right[1, b] + left[2, a] * right[2, b]
