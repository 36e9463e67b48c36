"""An array that grows row by row."""

from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Number = TypeVar("_Number", bound=np.generic)

_FIRST = 64
"""Rows there is room for at the start."""


class GrowingRows(Generic[_Number]):
    """Rows of one shape, appended one by one, each at the same cost on average: room doubles when it is used up."""

    def __init__(self, shape: tuple[int, ...], dtype: type[_Number]) -> None:
        """Start with no rows; each will have `shape`."""
        self._room: NDArray[_Number] = np.empty((_FIRST, *shape), dtype=dtype)
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def append(self, row: ArrayLike | Any) -> None:  # noqa: ANN401
        """Add one row."""
        if self._n == len(self._room):
            wider = np.empty((2 * self._n, *self._room.shape[1:]), dtype=self._room.dtype)
            wider[: self._n] = self._room
            self._room = wider
        self._room[self._n] = row
        self._n += 1

    @property
    def rows(self) -> NDArray[_Number]:
        """(n, ...) all rows: a view, which what is appended later is no part of."""
        return self._room[: self._n]
