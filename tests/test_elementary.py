"""Elementary functions against Python's own, number by number."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from graph.elementary import arctan2, cos_sin, exp, log

NUMBERS = arrays(np.float64, st.tuples(st.integers(0, 3), st.integers(0, 4)), elements=st.floats(-50, 50))


@given(NUMBERS)
def test_each_number_is_the_mathematical_librarys(x: NDArray[np.float64]) -> None:
    flat = x.ravel().tolist()
    cos, sin = cos_sin(x)
    assert cos.shape == sin.shape == x.shape
    assert cos.ravel().tolist() == list(map(math.cos, flat))
    assert sin.ravel().tolist() == list(map(math.sin, flat))
    assert exp(x).ravel().tolist() == list(map(math.exp, flat))
    assert log(np.abs(x) + 1.0).ravel().tolist() == [math.log(abs(number) + 1.0) for number in flat]
    assert arctan2(x, 2.0).ravel().tolist() == [math.atan2(number, 2.0) for number in flat]


def test_views_broadcasts_and_the_edges_of_the_logarithm() -> None:
    grid = np.arange(6.0).reshape(2, 3).T
    assert arctan2(grid, grid[:, :1]).tolist() == [[math.atan2(a, row[0]) for a in row] for row in grid.tolist()]
    assert cos_sin(grid)[0].tolist() == [[math.cos(a) for a in row] for row in grid.tolist()]
    assert log([0.0, 1.0]).tolist() == [-math.inf, 0.0]
    assert np.isnan(log([-1.0])).all()
