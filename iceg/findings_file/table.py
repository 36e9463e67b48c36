"""Arrays read back, each taken once its type and shape are what they must be."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iceg.findings_file.errors import FindingsError


class Table:
    """The arrays of a file of findings; whatever is taken from it is what it is taken for."""

    def __init__(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.path = path
        self._arrays = arrays

    def floats(self, name: str, *shape: int, is_nan_allowed: bool = False) -> NDArray[np.float64]:
        """Finite numbers of a shape; -1 stands for any length."""
        found = self._of(name, "f", shape)
        if not is_nan_allowed and not np.isfinite(found).all():
            raise self.error(f"'{name}' holds numbers that are not finite")
        return found.astype(np.float64)

    def whole(self, name: str, *shape: int, low: int = 0, high: int) -> NDArray[np.int64]:
        """Whole numbers from `low` to below `high`, of a shape; -1 stands for any length."""
        found = self._of(name, "iu", shape).astype(np.int64)
        if found.size and not (low <= found.min() and found.max() < high):
            raise self.error(
                f"'{name}' holds numbers from {found.min()} to {found.max()}, expected {low} to {high - 1}"
            )
        return found

    def flags(self, name: str, *shape: int) -> NDArray[np.bool_]:
        """Truth values of a shape."""
        return self._of(name, "b", shape).astype(np.bool_)

    def any_numbers(self, name: str, *shape: int) -> NDArray[Any]:
        """Numbers of any kind, of a shape."""
        return self._of(name, "iuf", shape)

    def bytes(self, name: str) -> bytes:
        """An array of bytes."""
        return self.whole(name, -1, high=256).astype(np.uint8).tobytes()

    def has(self, name: str) -> bool:
        """Whether there is an array of this name."""
        return name in self._arrays

    def error(self, what: str) -> FindingsError:
        """An error that names the file."""
        return FindingsError(f"{self.path}: cannot be read as the findings of a run: {what}")

    def _of(self, name: str, kinds: str, shape: tuple[int, ...]) -> NDArray[Any]:
        if name not in self._arrays:
            raise self.error(f"it holds no '{name}'")
        found = self._arrays[name]
        fits = len(found.shape) == len(shape) and all(
            wanted in (size, -1) for size, wanted in zip(found.shape, shape, strict=True)
        )
        if found.dtype.kind not in kinds or not fits:
            raise self.error(f"'{name}' is of type {found.dtype} and shape {found.shape}, expected shape {shape}")
        return found
