"""Plain numbers out of whatever NumPy would make numbers of."""

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from frontends.scan import ScanError

_Number = TypeVar("_Number", np.float32, np.float64)


def plain_numbers(name: str, values: ArrayLike | None, kind: type[_Number]) -> NDArray[_Number]:
    """An array of floats, NaN where a masked array hides a value.

    Raises:
        ScanError: these are dates or durations, of which NumPy makes counts of some unit.
        TypeError: these are no numbers, as for ValueError.
        ValueError: these are no numbers.
    """
    rows = values if isinstance(values, (list, tuple)) else ()
    array = np.ma.array(values) if any(isinstance(row, np.ma.MaskedArray) for row in rows) else np.asanyarray(values)
    if array.dtype.kind in "mM":
        first, kinds = (" - t[0]", "datetime64") if array.dtype.kind == "M" else ("", "timedelta64")
        raise ScanError(f'{name}: found {kinds}, expected seconds: (t{first}) / np.timedelta64(1, "s")')
    with np.errstate(over="ignore"):  # what no float32 can hold is no return
        if isinstance(array, np.ma.MaskedArray):
            return np.asarray(np.ma.filled(array.astype(kind), np.nan))
        return np.asarray(array, dtype=kind)
