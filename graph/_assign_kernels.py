"""Assignment of arrays in compiled loops."""

from typing import Any

from numpy.typing import NDArray

from graph.compiled import compiled_for_both


@compiled_for_both
def assign(target: NDArray[Any], values: NDArray[Any]) -> None:
    """target[:] = values, of the same shape.

    numba's own assignment composes a message for shapes that differ, out of strings: every function that holds it takes
    a second longer to compile, and so does every function that calls one.
    """
    for i in range(values.size):
        target.flat[i] = values.flat[i]
