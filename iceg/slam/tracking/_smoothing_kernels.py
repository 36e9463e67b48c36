"""Compiled loop that smooths a sequence between fixed ends: measured values, and steps from each to the next.

Either may be an outlier: both are taken to be distributed by Student's t, all axes of one together.
"""

from math import log

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_SETTLED = 1e-6
"""A reweighting that makes an optimum no more probable than by this, the logarithm, is the last."""


@compiled
def smooth(
    values: F64,
    steps: F64,
    firsts: I64,
    ends: F64,
    is_kept: NDArray[np.bool_],
    measured: F64,
    moved: F64,
    freedom: float,
    rounds: int,
    smoothed: F64,
) -> None:
    """The most probable values between fixed ones, by reweighted least squares along the chain of each part.

    It has more than one optimum where a value is an outlier, or the step to it: one is sought from the values, another
    from the steps, and the more probable one is taken.

    Args:
        values: (n, d) as measured.
        steps: (n + 1, d) from the value before to each, and from the last of a part to its end.
        firsts: (k + 1,) index of the fixed value that each part begins with, and n.
        ends: (k, d) the fixed value that each part leads to, NaN where it leads nowhere.
        is_kept: (k,) the parts that stay as they are.
        measured: (n, d) variance of each measured value …
        moved: (d,) … and of a step.
        freedom: degrees of freedom of either.
        rounds: most reweightings.
        smoothed: (n, d) output, filled for all but the parts that are kept.
    """
    longest = 0
    for part in range(len(firsts) - 1):
        longest = max(longest, firsts[part + 1] - firsts[part])
    by_values, by_steps = np.empty_like(values[:longest]), np.empty_like(values[:longest])
    for part in range(len(firsts) - 1):
        first, end = firsts[part], firsts[part + 1]
        if is_kept[part] or end - first < 2:
            continue
        one, other = by_values[: end - first], by_steps[: end - first]
        own, spread, moves, goal = values[first:end], measured[first:end], steps[first : end + 1], ends[part]
        one[:] = own
        _led_by_steps(own, moves, goal, other)
        cost = _reweighted(own, moves, goal, spread, moved, freedom, rounds, one)
        is_other = _reweighted(own, moves, goal, spread, moved, freedom, rounds, other) < cost
        smoothed[first:end] = other if is_other else one


@compiled
def _led_by_steps(values: F64, steps: F64, end: F64, found: F64) -> None:
    """Where steps lead from the first value, what they miss the end by shared among them."""
    n = len(values)
    found[0] = values[0]
    for axis in range(values.shape[1]):
        for i in range(1, n):
            found[i, axis] = found[i - 1, axis] + steps[i, axis]
        if not np.isnan(end[axis]):
            missed = end[axis] - found[n - 1, axis] - steps[n, axis]
            for i in range(1, n):
                found[i, axis] += missed * i / n


@compiled
def _reweighted(
    values: F64, steps: F64, end: F64, measured: F64, moved: F64, freedom: float, rounds: int, found: F64
) -> float:
    """Move values to an optimum near where they are; minus the logarithm of the density there, but for constants."""
    n = len(values)
    of_values, of_steps = np.empty(n), np.empty(n + 1)
    cost = _weigh(values, steps, end, measured, moved, freedom, found, of_values, of_steps)
    for _ in range(rounds):
        for axis in range(values.shape[1]):
            _solve(values, steps, end, axis, measured, moved[axis], of_values, of_steps, found)
        before, cost = cost, _weigh(values, steps, end, measured, moved, freedom, found, of_values, of_steps)
        if before - cost < _SETTLED:
            break
    return cost


@compiled
def _weigh(
    values: F64,
    steps: F64,
    end: F64,
    measured: F64,
    moved: F64,
    freedom: float,
    found: F64,
    of_values: F64,
    of_steps: F64,
) -> float:
    """Weights of the values and steps at the values found, and minus the logarithm of the density there."""
    n, axes, cost = len(values), values.shape[1], 0.0
    has_end = not np.isnan(end[0])
    for i in range(1, n + 1 if has_end else n):
        off, turned = 0.0, 0.0
        for axis in range(axes):
            there = found[i, axis] if i < n else end[axis]
            step = there - found[i - 1, axis] - steps[i, axis]
            turned += step * step / moved[axis]
            if i < n:
                value = there - values[i, axis]
                off += value * value / measured[i, axis]
        of_steps[i] = _weight(turned, axes, freedom)
        cost += _surprise(turned, axes, freedom)
        if i < n:
            of_values[i] = _weight(off, axes, freedom)
            cost += _surprise(off, axes, freedom)
    return cost


@compiled
def _weight(square: float, axes: int, freedom: float) -> float:
    return (freedom + axes) / (freedom + square)


@compiled
def _surprise(square: float, axes: int, freedom: float) -> float:
    return 0.5 * (freedom + axes) * log(1.0 + square / freedom)


@compiled
def _solve(
    values: F64,
    steps: F64,
    end: F64,
    axis: int,
    measured: F64,
    moved: float,
    of_values: F64,
    of_steps: F64,
    found: F64,
) -> None:
    """The normal equations of one axis of a chain, by elimination along it."""
    n = len(values)
    has_end = not np.isnan(end[axis])
    pivots, rights = np.empty(n), np.empty(n)
    for i in range(1, n):
        by_value, by_step = of_values[i] / measured[i, axis], of_steps[i] / moved
        pivot = by_value + by_step
        right = by_value * values[i, axis] + by_step * steps[i, axis]
        if i + 1 < n or has_end:
            by_next = of_steps[i + 1] / moved
            pivot += by_next
            right -= by_next * steps[i + 1, axis]
            if i + 1 == n:
                right += by_next * end[axis]
        if i == 1:
            right += by_step * values[0, axis]
        else:
            share = by_step / pivots[i - 1]
            pivot -= share * by_step
            right += share * rights[i - 1]
        pivots[i], rights[i] = pivot, right
    for i in range(n - 1, 0, -1):
        following = of_steps[i + 1] / moved * found[i + 1, axis] if i + 1 < n else 0.0
        found[i, axis] = (rights[i] + following) / pivots[i]
