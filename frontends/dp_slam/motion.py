"""Motions drawn around what the wheels report."""

import math

import numpy as np
from numpy.typing import NDArray

from frontends.dp_slam.config import MotionModel
from graph.elementary import cos_sin


def draw_motions(
    T_prev_cur: NDArray[np.float64], model: MotionModel, normals: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Draw motions of the robot (Eliazar and Parr, ICML 2004).

    Args:
        T_prev_cur: (3,) step as the odometry reports it.
        model: mean and spread.
        normals: (n, 3) standard normal numbers, for forwards, left and turn.

    Returns:
        (n, 3) steps, each in the frame of the robot before it.
    """
    x, y, turn = T_prev_cur.tolist()
    distance = math.hypot(x, y)
    c, s = math.cos(0.5 * turn), math.sin(0.5 * turn)
    forwards, left = c * x + s * y, c * y - s * x
    mean = (
        model.d_per_metre * forwards + model.d_per_radian * turn,
        left + model.c_per_metre * forwards + model.c_per_radian * turn,
        model.t_per_metre * forwards + model.t_per_radian * turn,
    )
    std = (
        max(model.d_std_per_metre * distance + model.d_std_per_radian * abs(turn), model.floor),
        max(model.c_std_per_metre * distance + model.c_std_per_radian * abs(turn), model.floor),
        max(model.t_std_per_metre * distance + model.t_std_per_radian * abs(turn), model.turn_floor),
    )
    d, to_left, turned = (np.array(mean) + normals * np.array(std)).T
    c_half, s_half = cos_sin(0.5 * turned)
    return np.stack([d * c_half - to_left * s_half, d * s_half + to_left * c_half, turned], axis=1)
