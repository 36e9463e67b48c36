"""How inner loops are compiled."""

from typing import Final, cast

import numpy as np
from numba import njit

compiled = njit(cache=True, error_model="numpy")
"""Decorator of a compiled function: kept on disk for the next run; division by zero gives infinity or NaN, as in NumPy.

Python's check of every divisor would cost a tenth of the time to compile.
"""

ZERO: Final = cast("int", np.int64(0))
"""A zero that is a number among others to a compiled function which hands it to the next …"""
ONE: Final = cast("int", np.int64(1))
"""… and such a one: for a literal, numba would compile the called function once more, for this very number."""
