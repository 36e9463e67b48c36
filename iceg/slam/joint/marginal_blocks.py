"""The blocks on the diagonal of the inverse of a matrix of poses, most of whose blocks are zero.

Poses that see no common wall share no block. In an order of poses that keeps those that share blocks close together
(Cuthill and McKee, 1969), only a band beside the diagonal is ever filled, and all that is needed of the inverse follows
from the blocks in that band (Takahashi et al., 1973).
"""

from dataclasses import dataclass

import numpy as np

from graph import dense
from graph.arrays import Bools, Floats, Ints

_TOGETHER = 32
"""Poses that are eliminated at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Panel:
    """Poses that are eliminated together, places in the order of elimination.

    Attributes:
        own: rows of the matrix that are theirs.
        later: rows that they share blocks with, or that lie between.
        root: L⁻¹ of their block L Lᵀ.
        coupling: (later, own) how the later ones hang on them.
    """

    own: slice
    later: slice
    root: Floats
    coupling: Floats


def diagonal_of_inverse(matrix: Floats) -> Floats:
    """(n, 3, 3) blocks on the diagonal of the inverse of a symmetric (3n, 3n) matrix.

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite.
    """
    shared = _shared(matrix)
    order = _order(shared)
    band, panels = _eliminated(matrix, order, _ends(shared[np.ix_(order, order)]))
    blocks = np.empty((len(order), 3, 3))
    for panel in reversed(panels):
        moved = dense.matmul(band[panel.later, panel.later], panel.coupling)
        inverse = dense.matmul(panel.root.T, panel.root) + dense.matmul(panel.coupling.T, moved)
        band[panel.own, panel.own] = inverse
        band[panel.later, panel.own], band[panel.own, panel.later] = -moved, -moved.T
        at = np.arange(len(inverse) // 3)
        poses = order[panel.own.start // 3 : panel.own.stop // 3]
        blocks[poses] = inverse.reshape(len(at), 3, len(at), 3)[at, :, at]
    return blocks


def close_together(matrix: Floats) -> Ints:
    """(n,) the poses of a symmetric (3n, 3n) matrix, in an order that keeps those that share blocks together."""
    return _order(_shared(matrix))


def _eliminated(matrix: Floats, order: Ints, ends: Ints) -> tuple[Floats, list[_Panel]]:
    """Eliminate all poses in an order; room for the inverse, and what became of each few of them."""
    n, panels = len(order), []
    blocks, band = matrix.reshape(n, 3, n, 3), np.zeros(matrix.shape)
    for first in range(0, n, _TOGETHER):
        last = min(first + _TOGETHER, n)
        end = max(last, int(ends[last - 1]))
        own, later = slice(3 * first, 3 * last), slice(3 * last, 3 * end)
        rows, columns = order[first:end, None], order[None, first:last]
        below = blocks[rows, :, columns].transpose(0, 2, 1, 3).reshape(3 * (end - first), 3 * (last - first))
        band[3 * first : 3 * end, own] += below
        root = dense.inv(dense.cholesky(band[own, own]))
        whitened = dense.matmul(band[later, own], root.T)
        band[later, later] -= dense.matmul(whitened, whitened.T)
        panels.append(_Panel(own=own, later=later, root=root, coupling=dense.matmul(whitened, root)))
    return band, panels


def _shared(matrix: Floats) -> Bools:
    """(n, n) which poses share a block."""
    filled = matrix != 0.0
    rows = filled[0::3] | filled[1::3] | filled[2::3]
    return np.asarray(rows[:, 0::3] | rows[:, 1::3] | rows[:, 2::3], dtype=np.bool_)


def _order(shared: Bools) -> Ints:
    """(n,) all poses, in an order that keeps those that share blocks close together."""
    degrees = np.count_nonzero(shared, axis=1)
    first = _spreading(shared, degrees, int(degrees.argmin()))
    there = _spreading(shared, degrees, first[-1])
    back = _spreading(shared, degrees, there[-1])
    orders = [np.array(order, dtype=np.int64) for order in (there, back)]
    widths = [_ends(shared[np.ix_(order, order)]) - np.arange(len(order)) for order in orders]
    return min(zip(orders, widths, strict=True), key=lambda pair: int((pair[1] ** 2).sum()))[0]


def _spreading(shared: Bools, degrees: Ints, start: int) -> list[int]:
    """All poses: one, those that share blocks with it, those that do with these, and so on."""
    left = np.ones(len(shared), dtype=np.bool_)
    order: list[int] = []
    for seed in (start, *range(len(shared))):
        if not left[seed]:
            continue
        left[seed] = False
        order.append(seed)
        at = len(order) - 1
        while at < len(order):
            new = np.flatnonzero(shared[order[at]] & left)
            left[new] = False
            order += new[np.argsort(degrees[new], kind="stable")].tolist()
            at += 1
    return order


def _ends(shared: Bools) -> Ints:
    """(n,) one past the last that any pose up to each one shares a block with."""
    return np.maximum.accumulate(len(shared) - np.argmax(shared[:, ::-1], axis=1))
