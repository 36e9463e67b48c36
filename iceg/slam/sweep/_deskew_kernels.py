"""Compiled loops that move beams by the motion since they were measured."""

from math import atan2, cos, floor, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


@compiled
def _pose_within(velocity: F64, change: F64, tau: float) -> tuple[float, float, float]:
    """exp(velocity τ + change τ² / 2), to second order in the angle: a sweep turns by less than a radian."""
    half = 0.5 * tau * tau
    x, y = velocity[0] * tau + change[0] * half, velocity[1] * tau + change[1] * half
    turn = velocity[2] * tau + change[2] * half
    c, s = cos(0.5 * turn), sin(0.5 * turn)
    return c * x - s * y, s * x + c * y, turn


@compiled
def deskew(ranges: F32, bearings: F64, velocity: F64, change: F64, share: float, full: bool, deskewed: F32) -> None:
    """Ranges as seen at once from the pose in the middle of each sweep.

    Each bearing takes the return that comes nearest to it, moved onto the bearing along its surface: along a wall 1/r
    is nearly linear in the bearing, and its slope is the smaller one of those to the two neighbours (minmod), so that
    nothing is drawn from one surface to another. The noise of a return stays its own.

    Args:
        ranges: (n, n_beams) as measured [m], NaN without return.
        bearings: (n_beams,) evenly spread [rad].
        velocity: (n, 3) of the laser per interval, see `MotionWithin`.
        change: (n, 3) of the velocity.
        share: the sweep in intervals, signed.
        full: whether the first beam follows the last one.
        deskewed: (n, n_beams) output.
    """
    n_beams = len(bearings)
    resolution = (bearings[n_beams - 1] - bearings[0]) / (n_beams - 1)
    seen, inverse, nearest = np.empty(n_beams), np.empty(n_beams), np.empty(n_beams)
    source = np.empty(n_beams, np.int64)
    for k in range(len(ranges)):
        _seen_from_middle(ranges[k], bearings, velocity[k], change[k], share, seen, inverse)
        nearest[:] = 1.0
        source[:] = -1
        for i in range(n_beams):
            place = (seen[i] - bearings[0]) / resolution
            lower = floor(place)
            for side in range(2):
                beam, off = int(lower) + side, abs(place - lower - side)
                if full:
                    beam %= n_beams
                if 0 <= beam < n_beams and off < nearest[beam]:
                    nearest[beam] = off
                    source[beam] = i
        for beam in range(n_beams):
            deskewed[k, beam] = np.nan
            i = source[beam]
            if i >= 0 and inverse[i] > 0.0:
                off = _wrapped(bearings[beam] - seen[i])
                deskewed[k, beam] = 1.0 / (inverse[i] + _change(seen, inverse, i, off, full))


@compiled
def _seen_from_middle(
    ranges: F32, bearings: F64, velocity: F64, change: F64, share: float, seen: F64, inverse: F64
) -> None:
    """Bearing and inverse range of each beam from the middle of the sweep; 0 for the inverse range without return."""
    n_beams = len(bearings)
    for i in range(n_beams):
        x, y, turn = _pose_within(velocity, change, share * (i / (n_beams - 1) - 0.5))
        seen[i], inverse[i] = bearings[i] + turn, 0.0
        r = ranges[i]
        if not np.isnan(r):
            x += r * cos(seen[i])
            y += r * sin(seen[i])
            inverse[i] = 1.0 / max(hypot(x, y), 1e-6)
            seen[i] += _wrapped(atan2(y, x) - seen[i])


@compiled
def _change(seen: F64, inverse: F64, i: int, off: float, full: bool) -> float:
    """Change of the inverse range over a bearing along the surface of a return; 0 at an edge or between surfaces."""
    n = len(seen)
    if not full and (i == 0 or i == n - 1):
        return 0.0
    left, right = (i + 1) % n, (i - 1) % n
    if inverse[left] == 0.0 or inverse[right] == 0.0:
        return 0.0
    to_left, to_right = _wrapped(seen[left] - seen[i]), _wrapped(seen[right] - seen[i])
    if not (to_left > 0.0 > to_right and to_right <= off <= to_left):
        return 0.0
    one, other = (inverse[left] - inverse[i]) / to_left, (inverse[right] - inverse[i]) / to_right
    if one * other <= 0.0:
        return 0.0
    slope: float = one if abs(one) < abs(other) else other
    return off * slope


@compiled
def _wrapped(angle: float) -> float:
    return angle - 2.0 * pi * floor((angle + pi) / (2.0 * pi))
