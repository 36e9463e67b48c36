"""Kernels that only other kernels call, called by a test."""

from collections.abc import Callable
from typing import Any

from numba import njit


def from_python(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """A function of Python's that calls a kernel whose name begins with an underscore."""

    @njit
    def calling(*arguments: Any) -> Any:
        return kernel(*arguments)

    function: Callable[..., Any] = calling
    return function
