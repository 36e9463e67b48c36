"""Compiled loop that smooths a sequence between fixed ends: measured values, and steps from each to the next."""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


@compiled
def smooth(
    values: F64,
    steps: F64,
    firsts: I64,
    ends: F64,
    is_kept: NDArray[np.bool_],
    measured: float,
    moved: float,
    smoothed: F64,
) -> None:
    """The most probable values between fixed ones: the normal equations of a chain, by elimination along it.

    Args:
        values: (n,) as measured.
        steps: (n,) from the value before to each, and from the last of a part to its end.
        firsts: (k + 1,) index of the fixed value that each part begins with, and n.
        ends: (k,) the fixed value that each part leads to, NaN where it leads nowhere.
        is_kept: (k,) the parts that stay as they are.
        measured: variance of a measured value …
        moved: … and of a step.
        smoothed: (n,) output, filled for all but the parts that are kept.
    """
    by_value, by_step = 1.0 / measured, 1.0 / moved
    pivots, rights = np.empty(len(values)), np.empty(len(values))
    for part in range(len(firsts) - 1):
        first, end = firsts[part], firsts[part + 1]
        if is_kept[part]:
            continue
        has_end = not np.isnan(ends[part])
        for i in range(first + 1, end):
            goes_on = i + 1 < end or has_end
            pivot = by_value + (2.0 if goes_on else 1.0) * by_step
            right = by_value * values[i] + by_step * steps[i]
            if i + 1 < end:
                right -= by_step * steps[i + 1]
            elif has_end:
                right += by_step * (ends[part] - steps[i + 1])
            if i == first + 1:
                right += by_step * values[first]
            else:
                share = by_step / pivots[i - 1]
                pivot -= share * by_step
                right += share * rights[i - 1]
            pivots[i], rights[i] = pivot, right
        for i in range(end - 1, first, -1):
            following = by_step * smoothed[i + 1] if i + 1 < end else 0.0
            smoothed[i] = (rights[i] + following) / pivots[i]
