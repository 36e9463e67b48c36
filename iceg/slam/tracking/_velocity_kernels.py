"""Compiled steps of the Kalman filter of a robot's velocity, of two by two blocks written out.

The state is by how much tracking is off, and the velocity, (x, y) each, in the robot's own frame, which turns with it;
`spread` is its (4, 4) covariance.
"""

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph.compiled import compiled

F64 = NDArray[np.float64]

_NOTHING_SEEN = 1e-2
"""A scan measures no direction less than this [1/m²]."""


@compiled
def predict(velocity: F64, spread: F64, turn: float, kept_aside: float, ahead: float, aside: float) -> None:
    """A step: the velocity goes on, the robot turns, and how fast it went was not known.

    Args:
        velocity: (2,) [m per scan], changed in place.
        spread: (4, 4), changed in place.
        turn: of the robot meanwhile [rad].
        kept_aside: share of the velocity to the side that is left.
        ahead: variance of the change of velocity along the robot …
        aside: … and to its side.
    """
    velocity[1] *= kept_aside
    c, s = cos(turn), sin(turn)
    for k in range(4):
        spread[3, k] *= kept_aside
    for k in range(4):
        spread[k, 3] *= kept_aside
    spread[2, 2] += ahead
    spread[3, 3] += aside
    moved = np.empty((4, 4))  # by the step: where tracking is off takes up the error of the velocity
    for a in range(4):
        for b in range(4):
            moved[a, b] = spread[a, b]
            if a < 2:
                moved[a, b] += spread[a + 2, b]
            if b < 2:
                moved[a, b] += spread[a, b + 2]
            if a < 2 and b < 2:
                moved[a, b] += spread[a + 2, b + 2]
    for b in range(4):  # what was ahead lies aside after a turn
        x, y = moved[0, b], moved[1, b]
        moved[0, b], moved[1, b] = c * x + s * y, c * y - s * x
    for a in range(4):
        x, y = moved[a, 0], moved[a, 1]
        moved[a, 0], moved[a, 1] = c * x + s * y, c * y - s * x
    assign(spread, moved)


@compiled
def correct(velocity: F64, spread: F64, offset: F64, information: F64, together: float, floor: float) -> None:
    """A match: tracking was off by as much, as far as the scan measures it, and the velocity by its share.

    Args:
        velocity: (2,) [m per scan], changed in place.
        spread: (4, 4), changed in place.
        offset: (2,) from the pose predicted to the one matched [m].
        information: (2, 2) how well the scan measures the position [1/m²].
        together: points in a row whose errors go together.
        floor: variance of a match at least [m²].
    """
    xx, yy = information[0, 0] + _NOTHING_SEEN, information[1, 1] + _NOTHING_SEEN
    xy = information[0, 1]
    scale = together / (xx * yy - xy * xy)
    a, b, d = spread[0, 0] + scale * yy + floor, spread[0, 1] - scale * xy, spread[1, 1] + scale * xx + floor
    determinant = a * d - b * b
    gain = np.empty((4, 2))
    for k in range(4):
        gain[k, 0] = (spread[k, 0] * d - spread[k, 1] * b) / determinant
        gain[k, 1] = (spread[k, 1] * a - spread[k, 0] * b) / determinant
    for k in range(2):
        velocity[k] += gain[k + 2, 0] * offset[0] + gain[k + 2, 1] * offset[1]
    for j in range(4):
        x, y = spread[0, j], spread[1, j]
        for i in range(4):
            spread[i, j] -= gain[i, 0] * x + gain[i, 1] * y
    for i in range(4):
        for j in range(i):
            spread[i, j] = spread[j, i] = 0.5 * (spread[i, j] + spread[j, i])
