"""Sorting of numbers in compiled loops."""

from typing import Any

from numpy.typing import NDArray

from graph.compiled import ZERO, compiled


@compiled
def _sort(values: NDArray[Any]) -> None:
    """Put the numbers (n,) in ascending order, in place; none is NaN.

    Heapsort (Williams 1964): numba's own sort and median take longer to compile than most kernels.
    """
    for root in range(len(values) // 2 - 1, -1, -1):
        _sift(values, root, len(values))
    for end in range(len(values) - 1, 0, -1):
        values[0], values[end] = values[end], values[0]
        _sift(values, ZERO, end)


@compiled
def _smallest(values: NDArray[Any], n: int) -> Any:  # noqa: ANN401
    """The n-th smallest, counted from 0, of numbers (m,), which change places; none is NaN. Hoare's FIND (1961)."""
    first, last = ZERO, len(values) - 1
    while first < last:
        middle = values[(first + last) // 2]
        i, j = first, last
        while i <= j:
            while values[i] < middle:
                i += 1
            while middle < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if j < n:
            first = i
        if n < i:
            last = j
    return values[n]


@compiled
def _sift(values: NDArray[Any], root: int, end: int) -> None:
    """Let a number sink to its place in the heap below `root`, which ends before `end`."""
    value = values[root]
    child = 2 * root + 1
    while child < end:
        if child + 1 < end and values[child + 1] > values[child]:
            child += 1
        if values[child] <= value:
            break
        values[root] = values[child]
        root, child = child, 2 * child + 1
    values[root] = value
