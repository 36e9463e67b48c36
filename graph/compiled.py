"""How inner loops are compiled."""

import logging
from collections.abc import Callable
from functools import cache
from typing import Any, Final, TypeVar, cast

import numpy as np
from numba import njit

_Function = TypeVar("_Function", bound=Callable[..., Any])
_compile: Any = njit  # its types know only some of the options
_for_this_process = _compile(error_model="numpy", no_cfunc_wrapper=True)
_kept = _compile(cache=True, error_model="numpy", no_cfunc_wrapper=True)
_for_this_process_aside = _compile(error_model="numpy", no_cfunc_wrapper=True, nogil=True)
_kept_aside = _compile(cache=True, error_model="numpy", no_cfunc_wrapper=True, nogil=True)
_within = _compile(error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True)


def compiled(function: _Function) -> _Function:
    """Decorator of a compiled function.

    It is kept on disk for the next run, where that can be written: beside the source, in the folder of the user's
    caches, or where `NUMBA_CACHE_DIR` says. Division by zero gives infinity or NaN, as in NumPy: Python's check of
    every divisor would cost a tenth of the time to compile.

    A name that begins with an underscore is for other compiled functions, which are kept with what they call: it is
    not kept itself, and Python cannot call it. That saves a sixth of the time to compile.
    """
    if function.__name__.startswith("_"):
        return cast("_Function", _within(function))
    return _decorated(function, _kept, _for_this_process)


def compiled_aside(function: _Function) -> _Function:
    """The same for a long loop that a thread runs while others go on: it leaves the interpreter to them."""
    return _decorated(function, _kept_aside, _for_this_process_aside)


def _decorated(function: _Function, kept: Callable[..., Any], for_this_process: Callable[..., Any]) -> _Function:
    try:
        return cast("_Function", kept(function))
    except RuntimeError:
        _warn()
        return cast("_Function", for_this_process(function))


@cache
def _warn() -> None:
    """Once, not for every kernel."""
    logging.getLogger(__name__).warning(
        "compiled kernels cannot be kept, each run compiles them: set NUMBA_CACHE_DIR to a folder that can be written"
    )


ZERO: Final = cast("int", np.int64(0))
"""A zero that is a number among others to a compiled function which hands it to the next …"""
ONE: Final = cast("int", np.int64(1))
"""… and such a one: for a literal, numba would compile the called function once more, for this very number."""
