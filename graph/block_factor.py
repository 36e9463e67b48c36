"""The Cholesky factor of an information matrix of poses, kept to ask for joint covariances of any of them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph import _sparse_kernels as sparse


class BlockFactor(NamedTuple):
    """L of H = L Lᵀ in blocks of 3×3, by columns, as `graph._sparse_kernels` keeps it.

    Attributes:
        row_of: (n,) row of each pose: its place in the order of elimination.
        starts: (n + 1,) first block below the diagonal of each column.
        rows: (b,) row of each of these blocks, increasing within a column …
        blocks: (b, 3, 3) … and the blocks.
        roots: (n, 3, 3) the blocks on the diagonal, lower triangles.
    """

    row_of: NDArray[np.int64]
    starts: NDArray[np.int64]
    rows: NDArray[np.int64]
    blocks: NDArray[np.float64]
    roots: NDArray[np.float64]

    def solve(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        """H⁻¹ b, both (n, 3) by pose."""
        ordered = np.empty_like(right)
        ordered[self.row_of] = right
        solved = sparse.solve_factored(self.starts, self.rows, self.blocks, self.roots, ordered)
        return np.asarray(solved[self.row_of])


def factorized(matrix: NDArray[np.float64], row_of: NDArray[np.int64]) -> BlockFactor:
    """The factor of a symmetric matrix.

    Args:
        matrix: (3n, 3n).
        row_of: (n,) place of each pose in the order of elimination.

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite.
    """
    n = len(row_of)
    pose_of = np.argsort(row_of, kind="stable")
    blocks = matrix.reshape(n, 3, n, 3).transpose(0, 2, 1, 3)[pose_of][:, pose_of]
    filled = np.triu((blocks != 0.0).any(axis=(2, 3)), 1)
    columns, rows = map(np.ascontiguousarray, np.nonzero(filled.T))
    column_starts = np.searchsorted(columns, np.arange(n + 1)).astype(np.int64)
    structure = sparse.factor_structure(n, column_starts, rows)
    values, roots = np.empty((len(structure[1]), 3, 3)), np.zeros((n, 3, 3))
    diagonal = np.ascontiguousarray(blocks[np.arange(n), np.arange(n)])
    upper = np.ascontiguousarray(blocks[rows, columns])
    if not sparse.factorize(column_starts, rows, upper, diagonal, *structure, values, roots):
        raise np.linalg.LinAlgError("the matrix is not positive definite")
    return BlockFactor(row_of, structure[0], structure[1], values, roots)
