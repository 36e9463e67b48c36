"""Arrays as JSON that a browser reads back as typed arrays."""

import base64
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

Kind = Literal["f4", "f8", "i4", "u2", "u1"]


def packed(array: ArrayLike, kind: Kind) -> dict[str, Any]:
    """An array as its type, shape and bytes, little-endian and in base64.

    Args:
        array: any shape; what does not fit the type must not be in it.
        kind: of its numbers in the page.
    """
    numbers = np.ascontiguousarray(array, dtype=f"<{kind}" if kind != "u1" else "u1")
    return {"type": kind, "shape": list(numbers.shape), "base64": base64.b64encode(numbers.data).decode("ascii")}
