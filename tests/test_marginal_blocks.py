"""The blocks on the diagonal of an inverse: against the whole inverse, however the poses share blocks."""

import numpy as np
import pytest
from numpy.typing import NDArray

from iceg.slam.joint.marginal_blocks import diagonal_of_inverse

Array = NDArray[np.float64]


def _matrix(pairs: list[tuple[int, int]], n: int, seed: int = 0) -> Array:
    """Positive definite; its blocks are zero but on the diagonal and between the pairs of poses."""
    rng = np.random.default_rng(seed)
    matrix = np.diag(rng.uniform(0.5, 1.0, 3 * n))
    for i, j in pairs:
        rows = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        jacobian = rng.normal(size=(2, 6))
        matrix[np.ix_(rows, rows)] += jacobian.T @ jacobian
    return matrix


def _expected(matrix: Array) -> Array:
    inverse = np.linalg.inv(matrix)
    return np.array([inverse[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(len(matrix) // 3)])


def _chain(n: int) -> list[tuple[int, int]]:
    return [(k, k + 1) for k in range(n - 1)]


@pytest.mark.parametrize(
    ("pairs", "n"),
    [
        ([], 1),
        ([], 40),  # nothing shared at all
        (_chain(100), 100),
        ([*_chain(100), (0, 99), (10, 60)], 100),  # loops
        ([(k, 0) for k in range(1, 70)], 70),  # one that all share a block with
        ([*_chain(50), *((50 + i, 50 + j) for i, j in _chain(30))], 80),  # two parts
        ([(i, j) for i in range(35) for j in range(i)], 35),  # everything shared
    ],
    ids=["one", "alone", "chain", "loops", "star", "parts", "full"],
)
def test_blocks_are_those_of_the_whole_inverse(pairs: list[tuple[int, int]], n: int) -> None:
    matrix = _matrix(pairs, n)
    kept = matrix.copy()
    found = diagonal_of_inverse(matrix)
    np.testing.assert_allclose(found, _expected(matrix), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(matrix, kept)


def test_the_order_of_the_poses_does_not_matter() -> None:
    n = 90
    rng = np.random.default_rng(1)
    matrix = _matrix([*_chain(n), (3, 80), (20, 55)], n)
    order = rng.permutation(n)
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    found = diagonal_of_inverse(matrix[np.ix_(rows, rows)])
    np.testing.assert_allclose(found, diagonal_of_inverse(matrix)[order], rtol=1e-9, atol=1e-12)


def test_a_matrix_that_is_not_positive_definite_is_refused() -> None:
    matrix = _matrix(_chain(60), 60)
    matrix[100, 100] = -1.0
    with pytest.raises(np.linalg.LinAlgError):
        diagonal_of_inverse(matrix)
