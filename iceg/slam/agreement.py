"""Whether two poses agree to within a tolerance: the one answer for closures, places, tracked poses and corrections."""

import math
from typing import NamedTuple

import numpy as np

from graph.arrays import Bools, Floats
from graph.se2 import wrap_angle


class Tolerance(NamedTuple):
    """How far apart two poses may be and still agree."""

    distance: float
    """… [m]."""
    turn: float
    """… [rad]."""

    @property
    def deviations(self) -> Floats:
        """(3,) the same as standard deviations [m, m, rad]."""
        return np.array([self.distance, self.distance, self.turn])

    @property
    def covariance(self) -> Floats:
        """(3, 3) of errors with these standard deviations [m², m², rad²]."""
        return np.diag(self.deviations**2)


def is_small(T_a_b: Floats, tolerance: Tolerance) -> bool:
    """Whether one pose, (3,) in the frame of another, agrees with it."""
    x, y, turn = T_a_b.tolist()
    return bool(x * x + y * y < tolerance.distance**2 and abs(turn) < tolerance.turn)


def are_small(T_a_b: Floats, tolerance: Tolerance) -> Bools:
    """The same of many, (n, 3)."""
    x, y, turn = T_a_b.T
    return np.asarray((x * x + y * y < tolerance.distance**2) & (np.abs(turn) < tolerance.turn))


def agree(T_a_b: Floats, T_a_c: Floats, tolerance: Tolerance) -> bool:
    """Whether two poses, (3,) in one frame, agree."""
    distance, turn = apart(T_a_b, T_a_c)
    return distance < tolerance.distance and turn < tolerance.turn


def apart(T_a_b: Floats, T_a_c: Floats) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses; plain floats, for the loop over scans."""
    (x, y, heading), (x_c, y_c, heading_c) = T_a_b.tolist(), T_a_c.tolist()
    return math.hypot(x_c - x, y_c - y), abs(wrap_angle(heading_c - heading))
