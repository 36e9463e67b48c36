"""How inner loops are compiled."""

import sys
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


def _load_numba_without_scipy() -> None:
    """Load now what numba loads with the first function, while SciPy's linear algebra cannot be found.

    It would load all of `scipy.linalg` only to learn whether BLAS is there for `np.convolve` and `np.correlate`, which
    take a plain loop without it: a sixth of a second of every start. Compiled `np.dot` and `np.linalg` look for BLAS
    and LAPACK again when they are used.
    """
    if "scipy.linalg" in sys.modules:
        return
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
    try:
        import numba.np.arraymath  # noqa: F401
    except ImportError:
        pass  # not where numba asks any more
    finally:
        del sys.modules["scipy.linalg"]


_load_numba_without_scipy()
