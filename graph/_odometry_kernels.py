"""Compiled loop that carries an odometry motion and its covariance over increments."""

from math import cos, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled_for_both

F64 = NDArray[np.float64]


@compiled_for_both
def carry(pose: F64, covariance: F64, increments: F64, variances: F64) -> tuple[float, float]:
    """Extend a motion by increments: A C Aᵀ + own for each, A the adjoint of the increment's inverse.

    Args:
        pose: (3,) T_key_robot, changed in place.
        covariance: (3, 3) in the tangent space at it, changed in place.
        increments: (n, 3) each in the frame of the pose before it.
        variances: (5,) along and across per metre, position per radian, heading per metre and per radian.

    Returns:
        Path length [m] and sum of |heading change| [rad] of the increments.
    """
    path, turned = 0.0, 0.0
    for k in range(len(increments)):
        x, y, heading = increments[k, 0], increments[k, 1], increments[k, 2]
        distance, turn = hypot(x, y), abs(heading)
        path += distance
        turned += turn
        c, s = cos(pose[2]), sin(pose[2])
        pose[0] += c * x - s * y
        pose[1] += s * x + c * y
        pose[2] += heading
        if not -pi < pose[2] <= pi:
            pose[2] = pi - (pi - pose[2]) % (2.0 * pi)
        xx, xy, xh = covariance[0, 0], covariance[0, 1], covariance[0, 2]
        yy, yh, hh = covariance[1, 1], covariance[1, 2], covariance[2, 2]
        c, s = cos(heading), sin(heading)
        u, v = c * x + s * y, c * y - s * x  # the direction of travel, seen from the end
        # C Aᵀ's columns for the rows (c, s, -v) and (-s, c, u) of A
        ax, ay, ah = c * xx + s * xy - v * xh, c * xy + s * yy - v * yh, c * xh + s * yh - v * hh
        bx, by, bh = c * xy - s * xx + u * xh, c * yy - s * xy + u * yh, c * yh - s * xh + u * hh
        stretch = (variances[0] - variances[1]) / distance if distance > 0.0 else 0.0
        any_direction = variances[1] * distance + variances[2] * turn
        covariance[0, 0] = c * ax + s * ay - v * ah + any_direction + stretch * u * u
        covariance[1, 1] = c * by - s * bx + u * bh + any_direction + stretch * v * v
        covariance[0, 1] = covariance[1, 0] = c * bx + s * by - v * bh + stretch * u * v
        covariance[0, 2] = covariance[2, 0] = ah
        covariance[1, 2] = covariance[2, 1] = bh
        covariance[2, 2] = hh + variances[3] * distance + variances[4] * turn
    return path, turned
