"""Compiled loops that tell how much wall holds a match: a post holds it along a corridor, and so does a wall across."""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

F64 = NDArray[np.float64]

_WIDEST_GAP = 0.6
"""Neighbouring points farther apart than this are of two surfaces [m]."""
_LEAST_HELD = 1e-6
"""A turn is taken to be held by no less than this [m of wall, times m² of lever], …"""
_MOST_TURN = 1.0
"""… and no slide to turn by more than this [rad/m]."""


@compiled
def _lengths(points: F64, lengths: F64) -> None:
    """How much of its surface each of (n, 2) points in the order of their beams stands for [m]."""
    lengths[:] = 0.0
    for i in range(1, len(points)):
        dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        gap = sqrt(dx * dx + dy * dy)
        if gap < _WIDEST_GAP:
            lengths[i - 1] += 0.5 * gap
            lengths[i] += 0.5 * gap


@compiled
def _held(levers: F64, own_levers: F64, lengths: F64, directions: F64, held: F64) -> None:
    """Along which directions the position is held least and most, and by how many metres of wall.

    That is Σ l (Jv)(J'v) over points that stand for l metres of wall each, J by the normals of their surfels and J' by
    their own, as in `_score_kernels._pretence`: a wall that faces along v counts in full, one beside hardly, and what
    was matched to a surface that faces another way does not. The turn follows the position as the walls want it (Schur
    complement), so that a slide along a curved wall turns along with it.

    Args:
        levers: (n, 3) derivatives of the distances by a step of the robot in its own frame …
        own_levers: (n, 3) … and by the points' own normals.
        lengths: (n,) [m].
        directions: (2, 3) output: x, y of length 1, and the turn that goes along [rad/m]; held least first.
        held: (2,) output [m].
    """
    told = np.zeros((3, 3))
    for i in range(len(lengths)):
        for a in range(3):
            for b in range(3):
                told[a, b] += lengths[i] * levers[i, a] * own_levers[i, b]
    turn = max(told[2, 2], _LEAST_HELD)
    tx, ty = -0.5 * (told[0, 2] + told[2, 0]) / turn, -0.5 * (told[1, 2] + told[2, 1]) / turn
    xx, yy = told[0, 0] - turn * tx * tx, told[1, 1] - turn * ty * ty
    xy = 0.5 * (told[0, 1] + told[1, 0]) - turn * tx * ty
    mean, difference = 0.5 * (xx + yy), 0.5 * (xx - yy)
    root = sqrt(difference * difference + xy * xy)
    held[0], held[1] = mean - root, mean + root
    # Eigenvector of the smaller eigenvalue, from the better conditioned row.
    x, y = (xy, -difference - root) if difference > 0.0 else (difference - root, xy)
    length = sqrt(x * x + y * y)
    x, y = (1.0, 0.0) if length == 0.0 else (x / length, y / length)
    directions[0, 0], directions[0, 1], directions[0, 2] = x, y, tx * x + ty * y
    directions[1, 0], directions[1, 1], directions[1, 2] = -y, x, ty * x - tx * y
    for k in range(2):
        directions[k, 2] = min(max(directions[k, 2], -_MOST_TURN), _MOST_TURN)
