"""The iterations of ICP, PLICP, MbICP and IDC, compiled: pairs, their fit, and again until nothing moves."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.matchers._fit_kernels import composed, line_fit, metric_normal_equations, rigid_fit, take
from frontends.matchers._outline_kernels import Outline
from frontends.matchers._pair_kernels import (
    Pairs,
    Trimming,
    associate,
    associate_range,
    drop_doubles,
    drop_hidden,
    measure_to_lines,
    no_pairs,
    trim,
)
from graph._dense_kernels import _solve_one
from graph.compiled import compiled

_SAME_WAY = math.cos(math.radians(10.0))
"""Two steps point the same way when the cosine of the angle between them exceeds this …"""
_TURN_LENGTH = 3.0
"""… turns counting as much as a shift by this [m]; …"""
_SHORT = 0.02
"""… such a way is followed once a step is shorter than this [m]: long ones lead on towards chance pairs …"""
_FARTHEST = 10.0
"""… and by this many steps at most."""


class Stopping(NamedTuple):
    """When the iterations end: after so many, or when one moves the scan by less than `epsilon` [m, rad]."""

    iterations: int
    epsilon: float


@compiled
def closest_points(
    outline: Outline,
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    length2: float,
    window: float,
    trimming: Trimming,
    stopping: Stopping,
) -> tuple[NDArray[np.float64], Pairs, int]:
    """Nearest places and least squares, both in the metric that weighs a turn by the squared length.

    An infinite length is ICP, a finite one MbICP, which leaves out hidden points too.

    Returns:
        The pose of the scan in the frame of the reference, the last pairs, and the number of iterations.
    """
    pose, pairs, done = start.copy(), no_pairs(len(points)), 0
    before, step, steps = np.zeros(3), np.zeros(3), np.zeros((2, 3))
    while done < stopping.iterations:
        done += 1
        associate(outline, points, pose, length2, window, trimming, pairs)
        if not math.isinf(length2):
            drop_hidden(pairs)
        if trim(trimming, pairs) < 3:
            break
        if math.isinf(length2):
            fit = rigid_fit(points, pairs.targets, pairs.kept)
        else:
            H, g = metric_normal_equations(pairs.moved, pairs.targets, pairs.kept, length2)
            if not _solve_one(H, g, step):
                break
            fit = composed(step[0], step[1], step[2], pose)
        before[:] = pose
        if take(fit, pose, stopping.epsilon):
            break
        _accelerate(before, pose, steps)
    return pose, pairs, done


@compiled
def _accelerate(before: NDArray[np.float64], pose: NDArray[np.float64], steps: NDArray[np.float64]) -> None:
    """Go on where two steps point the same way, to where such steps lead to in the end (Besl and McKay 1992, IV.C).

    Args:
        before: (3,) pose before the last step.
        pose: (3,) after it; moved.
        steps: (2, 3) the last two plain steps, zero where there are none.
    """
    for i in range(3):
        steps[0, i] = steps[1, i]
        steps[1, i] = pose[i] - before[i]
    steps[1, 2] = _TURN_LENGTH * ((steps[1, 2] + math.pi) % (2.0 * math.pi) - math.pi)
    first = second = along = 0.0
    for i in range(3):
        first += steps[0, i] ** 2
        second += steps[1, i] ** 2
        along += steps[0, i] * steps[1, i]
    if second > _SHORT**2 or first == 0.0 or second == 0.0 or along < _SAME_WAY * math.sqrt(first * second):
        return
    ratio = math.sqrt(second / first)
    ahead = _FARTHEST if ratio >= _FARTHEST / (1.0 + _FARTHEST) else ratio / (1.0 - ratio)
    pose[0] += ahead * steps[1, 0]
    pose[1] += ahead * steps[1, 1]
    pose[2] += ahead * steps[1, 2] / _TURN_LENGTH
    steps[:] = 0.0


@compiled
def closest_lines(
    outline: Outline,
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    damping: float,
    trimming: Trimming,
    stopping: Stopping,
) -> tuple[NDArray[np.float64], Pairs, int]:
    """Distances to the lines through the nearest pieces of the outline, minimised in closed form; as above."""
    pose, pairs, done = start.copy(), no_pairs(len(points)), 0
    while done < stopping.iterations:
        done += 1
        associate(outline, points, pose, math.inf, math.pi, trimming, pairs)
        measure_to_lines(pairs)
        drop_doubles(len(outline.xy), pairs)
        if trim(trimming, pairs) < 3:
            break
        x, y, angle = line_fit(pairs.moved, pairs.targets, pairs.normals, pairs.kept, damping)
        if take(composed(x, y, angle, pose), pose, stopping.epsilon):
            break
    return pose, pairs, done


@compiled
def dual(
    outline: Outline,
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    window: float,
    decay: float,
    min_window: float,
    trimming: Trimming,
    stopping: Stopping,
) -> tuple[NDArray[np.float64], Pairs, int]:
    """Translation from the nearest places, rotation from those at matching range, in a window that narrows."""
    pose, pairs, done = start.copy(), no_pairs(len(points)), 0
    ranges = np.sqrt(outline.xy[:, 0] ** 2 + outline.xy[:, 1] ** 2)
    at_range = no_pairs(len(points))
    while done < stopping.iterations:
        opening = max(window * math.exp(-decay * done), min_window)
        done += 1
        associate(outline, points, pose, math.inf, opening, trimming, pairs)
        at_range.moved[:] = pairs.moved
        associate_range(outline, ranges, opening, trimming.max_distance, at_range)
        if trim(trimming, pairs) < 3:
            break
        fit = rigid_fit(points, pairs.targets, pairs.kept)
        if trim(trimming, at_range) >= 3:
            fit = (fit[0], fit[1], rigid_fit(points, at_range.targets, at_range.kept)[2])
        if take(fit, pose, stopping.epsilon) and opening <= min_window:
            break
    return pose, pairs, done
