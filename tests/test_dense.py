"""Dense algebra against NumPy's, and in its own terms where results are not unique."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from graph import dense

Floats = NDArray[np.float64]
SIZES = st.tuples(st.integers(0, 4), st.integers(1, 6))
NUMBERS = st.floats(-10, 10, width=32)


@st.composite
def stacks(draw: st.DrawFn) -> Floats:
    n, size = draw(SIZES)
    return draw(arrays(np.float64, (n, size, size), elements=NUMBERS))


@given(stacks())
def test_products(a: Floats) -> None:
    b = np.swapaxes(a, 1, 2) + 1.0
    assert_allclose(dense.matmul(a, b, a), a @ b @ a, rtol=1e-12, atol=1e-9)
    assert_allclose(dense.congruence(a, b), a @ b @ np.swapaxes(a, 1, 2), rtol=1e-12, atol=1e-9)
    assert_allclose(dense.matvec(a, a[:, 0]), (a @ a[:, 0, :, None])[..., 0], rtol=1e-12, atol=1e-9)
    assert dense.vecdot(a, b) == pytest.approx(float((a * b).sum()))


def test_batches_broadcast() -> None:
    rng = np.random.default_rng(1)
    one, many, outer = rng.normal(size=(2, 3)), rng.normal(size=(5, 3, 4)), rng.normal(size=(2, 1, 3, 3))
    assert_allclose(dense.matmul(one, many), one @ many)
    assert_allclose(dense.matmul(outer, many), outer @ many)
    assert dense.solve(outer, many).shape == (2, 5, 3, 4)
    assert dense.matmul(np.zeros((3, 0)), np.zeros((0, 2))).tolist() == np.zeros((3, 2)).tolist()


@given(stacks())
def test_solutions_of_well_conditioned_systems(a: Floats) -> None:
    size = a.shape[-1]
    a = a + np.where(np.eye(size) > 0, 100.0 * np.sign(np.diagonal(a, axis1=1, axis2=2)[..., None] + 0.5), 0.0)
    b = a[:, :, :1] + 2.0
    assert_allclose(dense.matmul(a, dense.solve(a, b)), b, atol=1e-10)
    assert_allclose(dense.matmul(dense.inv(a), a), np.broadcast_to(np.eye(size), a.shape), atol=1e-12)
    assert_allclose(dense.solve_vector(a, b[..., 0]), dense.solve(a, b)[..., 0])


def test_rows_are_exchanged_where_a_pivot_vanishes() -> None:
    assert_array_equal(dense.inv([[0.0, 2.0], [1.0, 0.0]]), [[0.0, 1.0], [0.5, 0.0]])


def test_singular_matrices_are_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        dense.inv([[1.0, 2.0], [2.0, 4.0]])
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        dense.cholesky([[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        dense.cholesky([[np.nan]])


@given(stacks())
def test_roots_and_axes_of_symmetric_matrices(a: Floats) -> None:
    square = dense.congruence(a, np.eye(a.shape[-1]))
    root = dense.cholesky(square + 0.1 * np.eye(a.shape[-1]))
    assert_allclose(dense.matmul(root, np.swapaxes(root, 1, 2)), square + 0.1 * np.eye(a.shape[-1]), atol=1e-9)
    assert_array_equal(root, np.tril(root))
    values, axes = dense.eigh(square)
    assert_allclose(values, np.linalg.eigvalsh(square), atol=1e-9)
    assert_allclose(
        dense.congruence(axes, np.eye(a.shape[-1])), np.broadcast_to(np.eye(a.shape[-1]), a.shape), atol=1e-12
    )
    assert_allclose(dense.matmul(axes * values[:, None, :], np.swapaxes(axes, 1, 2)), square, atol=1e-9)


def test_small_eigenvalues_beside_large_ones() -> None:
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    values, _ = dense.eigh(dense.congruence(turn, np.diag([1e-8, 1.0, 1e4])))
    assert_allclose(values, [1e-8, 1.0, 1e4], rtol=1e-3)


@given(stacks())
def test_the_shortest_of_the_best_solutions(a: Floats) -> None:
    for matrix in a:
        rows = matrix[:, : max(1, matrix.shape[1] - 1)]  # of less than full rank
        square, right = rows @ rows.T, rows @ np.ones(rows.shape[1])
        found = dense.least_norm_solution(square, right)
        assert_allclose(square @ found, right, atol=1e-6 * max(1.0, float(np.abs(right).max())))
