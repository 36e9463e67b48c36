"""Decimal numbers out of bytes, compiled."""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both

_EXACT_INTEGERS = 2**53  # a float64 holds every integer up to here
_EXACT_DECIMALS = 22  # and every power of ten up to here: their quotient is rounded once, as float() rounds


@compiled
def _is_space(byte: int) -> bool:
    """Whether Python's `bytes.split` parts words there."""
    return byte == 32 or 9 <= byte <= 13


@compiled_for_both
def scan_numbers(text: NDArray[np.uint8], start: int, stop: int, out: NDArray[np.float64]) -> tuple[int, int]:
    """Read numbers parted by white space into `out` until it is full or a token is no plain decimal number.

    Returns:
        How many were read, and where the first one not read begins.
    """
    position = start
    for index in range(len(out)):
        while position < stop and _is_space(text[position]):
            position += 1
        begin = position
        negative = False
        if position < stop and (text[position] == 45 or text[position] == 43):
            negative = text[position] == 45
            position += 1
        mantissa = np.int64(0)
        digits = 0
        decimals = -1
        scale = 1.0
        while position < stop:
            byte = np.int64(text[position])
            if 48 <= byte <= 57:
                if mantissa > (_EXACT_INTEGERS - 10) // 10:
                    return index, begin
                mantissa = mantissa * 10 + (byte - 48)
                digits += 1
                if decimals >= 0:
                    decimals += 1
                    scale *= 10.0
            elif byte == 46 and decimals < 0:
                decimals = 0
            else:
                break
            position += 1
        if digits == 0 or decimals > _EXACT_DECIMALS or (position < stop and not _is_space(text[position])):
            return index, begin
        value = np.float64(mantissa) / scale
        out[index] = -value if negative else value
    return len(out), position
