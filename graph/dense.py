"""Small dense algebra with the same digits on every machine.

Libraries of linear algebra choose their kernels by the processor they find, and sums in another order round another
way; a decision that hangs on the last digit then differs from machine to machine. These functions do what NumPy's of
the same names do, in one fixed order. Matrices are stacks (..., i, k); batch axes lead and broadcast.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from graph.arrays import Floats


def matmul(first: ArrayLike, *others: ArrayLike) -> Floats:
    """The product of matrices, from left to right.

    Args:
        first: (..., i, k).
        *others: (..., k, j) and so on.

    Returns:
        (..., i, j).
    """
    product = np.asarray(first, dtype=np.float64)
    for other in others:
        product = _product(product, np.asarray(other, dtype=np.float64))
    return product


def matvec(matrix: ArrayLike, vector: ArrayLike) -> Floats:
    """(..., i) the product of (..., i, k) matrices with (..., k) vectors."""
    return matmul(matrix, np.asarray(vector, dtype=np.float64)[..., None])[..., 0]


def congruence(matrix: ArrayLike, covariance: ArrayLike) -> Floats:
    """A S Aᵀ, what a linear map makes of a covariance.

    Args:
        matrix: (..., i, k) A.
        covariance: (..., k, k) S.

    Returns:
        (..., i, i), symmetric to rounding.
    """
    from graph import _dense_kernels as kernels

    a, s = np.asarray(matrix, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    batch = np.broadcast_shapes(a.shape[:-2], s.shape[:-2])
    turned = np.empty((math.prod(batch), a.shape[-2], a.shape[-2]))
    kernels.congruence(_stack(a, batch), _stack(s, batch), turned)
    return turned.reshape(*batch, *turned.shape[1:])


def vecdot(first: ArrayLike, second: ArrayLike) -> float:
    """The sum of the products of the elements of two arrays of one shape."""
    return float(np.sum(np.asarray(first, dtype=np.float64) * np.asarray(second, dtype=np.float64)))


def inv(matrices: ArrayLike) -> Floats:
    """(..., k, k) inverses of (..., k, k) matrices.

    Raises:
        numpy.linalg.LinAlgError: one is singular.
    """
    matrices = np.asarray(matrices, dtype=np.float64)
    return solve(matrices, np.eye(matrices.shape[-1]))


def solve(matrices: ArrayLike, right: ArrayLike) -> Floats:
    """(..., k, m) solutions x of A x = b for (..., k, k) matrices A and (..., k, m) matrices b.

    Raises:
        numpy.linalg.LinAlgError: one A is singular.
    """
    from graph import _dense_kernels as kernels

    a, b = np.asarray(matrices, dtype=np.float64), np.asarray(right, dtype=np.float64)
    batch = np.broadcast_shapes(a.shape[:-2], b.shape[:-2])
    stack, solution = _copied(a, batch), _copied(b, batch)
    if not kernels.solve(stack, solution):
        raise np.linalg.LinAlgError("a matrix is singular")
    return solution.reshape(*batch, *b.shape[-2:])


def least_norm_solution(matrix: ArrayLike, right: ArrayLike) -> Floats:
    """(k,) x with the least |A x − b|, of these the shortest; (k, k) A is symmetric, without negative eigenvalues."""
    values, axes = eigh(matrix)
    known = values > values[-1] * len(values) * np.finfo(np.float64).eps
    along = matvec(axes.T, right)
    return matvec(axes, np.where(known, along / np.where(known, values, 1.0), 0.0))


def solve_vector(matrix: ArrayLike, right: ArrayLike) -> Floats:
    """(..., k) solutions x of A x = b for (..., k, k) matrices A and (..., k) vectors b.

    Raises:
        numpy.linalg.LinAlgError: one A is singular.
    """
    return solve(matrix, np.asarray(right, dtype=np.float64)[..., None])[..., 0]


def cholesky(matrices: ArrayLike) -> Floats:
    """(..., k, k) lower triangles L with L Lᵀ = A of (..., k, k) symmetric matrices A, whose lower halves are read.

    Raises:
        numpy.linalg.LinAlgError: one is not positive definite.
    """
    from graph import _dense_kernels as kernels

    matrices = np.asarray(matrices, dtype=np.float64)
    roots = _copied(matrices, matrices.shape[:-2])
    if not kernels.factorize(roots):
        raise np.linalg.LinAlgError("a matrix is not positive definite")
    return roots.reshape(matrices.shape)


def eigh(matrices: ArrayLike) -> tuple[Floats, Floats]:
    """Eigenvalues, increasing, and eigenvectors of symmetric matrices.

    Which of the directions that share an eigenvalue are returned is as arbitrary as anywhere; nothing may hang on it.

    Args:
        matrices: (..., k, k), finite.

    Returns:
        (..., k) and (..., k, k), the eigenvectors in the columns.
    """
    from graph import _dense_kernels as kernels

    matrices = np.asarray(matrices, dtype=np.float64)
    rotated = _copied(0.5 * (matrices + np.swapaxes(matrices, -1, -2)), matrices.shape[:-2])
    size = matrices.shape[-1]
    axes = np.tile(np.eye(size), (len(rotated), 1, 1))
    kernels.diagonalize(rotated, axes)
    values = np.diagonal(rotated, axis1=1, axis2=2)
    order = np.argsort(values, axis=1, kind="stable")
    values = np.take_along_axis(values, order, 1).reshape(matrices.shape[:-1])
    return values, np.take_along_axis(axes, order[:, None, :], 2).reshape(matrices.shape)


def eigvalsh(matrices: ArrayLike) -> Floats:
    """(..., k) eigenvalues of (..., k, k) symmetric matrices, increasing."""
    return eigh(matrices)[0]


def _product(a: Floats, b: Floats) -> Floats:
    from graph import _dense_kernels as kernels

    batch = np.broadcast_shapes(a.shape[:-2], b.shape[:-2])
    shape = (*batch, a.shape[-2], b.shape[-1])
    product = np.zeros((math.prod(batch), *shape[-2:]))
    kernels.multiply(_stack(a, batch), _stack(b, batch), product)
    return product.reshape(shape)


def _stack(a: Floats, batch: tuple[int, ...]) -> Floats:
    """(n or 1, i, k), contiguous; one matrix is not repeated."""
    if a.ndim > 2 and a.shape[:-2] != batch:
        a = np.broadcast_to(a, (*batch, *a.shape[-2:]))
    return np.ascontiguousarray(a.reshape(math.prod(a.shape[:-2]), *a.shape[-2:]))


def _copied(a: Floats, batch: tuple[int, ...]) -> Floats:
    """(n, i, k) of its own."""
    if a.shape[:-2] != batch:
        a = np.broadcast_to(a, (*batch, *a.shape[-2:]))
    return np.array(a.reshape(math.prod(batch), *a.shape[-2:]), order="C")
