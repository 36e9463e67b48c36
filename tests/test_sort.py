"""Sorting in compiled loops."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from graph import _sort_kernels as kernels
from tests.kernels import from_python

sort, smallest = from_python(kernels._sort), from_python(kernels._smallest)


@given(st.lists(st.integers(-5, 40)))
def test_numbers_ascend(numbers: list[int]) -> None:
    values = np.array(numbers, np.int64)
    sort(values)
    assert values.tolist() == sorted(numbers)


@given(st.lists(st.floats(allow_nan=False)))
def test_what_is_not_whole_ascends_as_well(numbers: list[float]) -> None:
    values = np.array(numbers, np.float64)
    sort(values)
    assert values.tolist() == sorted(numbers)


@given(st.lists(st.floats(allow_nan=False), min_size=1), st.data())
def test_the_nth_smallest_is_where_sorting_puts_it(numbers: list[float], data: st.DataObject) -> None:
    n = data.draw(st.integers(0, len(numbers) - 1))
    values = np.array(numbers, np.float64)
    assert smallest(values, n) == sorted(numbers)[n]
    assert sorted(values.tolist()) == sorted(numbers)
