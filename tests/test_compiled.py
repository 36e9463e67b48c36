"""How inner loops are compiled: numbers and arrays handed from one to the next."""

import os
from typing import Any

import numpy as np
import pytest
from numba import njit

from graph._assign_kernels import assign
from graph.compiled import ONE, ZERO


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_a_number_handed_on_does_not_compile_the_next_function_for_itself() -> None:
    twice: Any = njit(lambda number: 2 * number)
    with_literal: Any = njit(lambda: twice(1))
    with_constants: Any = njit(lambda: twice(ONE) + twice(ZERO))

    assert with_constants() == 2
    assert len(twice.signatures) == 1
    with_literal()
    assert len(twice.signatures) == 2, "numba no longer does this: ONE and ZERO are not needed any more"


@pytest.mark.parametrize("shape", [(4,), (3, 2), (0,)])
def test_assign_copies_into_what_is_there(shape: tuple[int, ...]) -> None:
    values = np.arange(float(np.prod(shape))).reshape(shape)
    whole = np.full((2, *shape), -1.0)
    assign(whole[1], values)
    np.testing.assert_array_equal(whole, [np.full(shape, -1.0), values])
