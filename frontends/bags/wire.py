"""Reading one serialised message, as ROS 1 or as ROS 2 (CDR) writes it.

Sources: ROS 1 `rosmsg` serialisation (little endian, no padding); OMG CDR 1.0 as ROS 2 uses it: four bytes say the byte
order, numbers are aligned to their size counted from behind them, a string's length counts its closing zero.
"""

import struct
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from frontends.bags._echo_kernels import first_echoes
from frontends.bags.errors import MalformedMessageError

_BYTE_ORDERS = {b"\0\1": "<", b"\0\0": ">"}
"""By the first two bytes of CDR's four."""
_ORDERS = {
    "<": (struct.Struct("<I"), struct.Struct("<III"), struct.Struct("<iII"), np.dtype("<f4"), np.dtype("<f8")),
    ">": (struct.Struct(">I"), struct.Struct(">III"), struct.Struct(">iII"), np.dtype(">f4"), np.dtype(">f8")),
}
_DOUBLES = {(order, n): struct.Struct(f"{order}{n}d") for order in "<>" for n in (3, 4, 7)}
_FLOATS = {(order, n): struct.Struct(f"{order}{n}f") for order in "<>" for n in (7,)}


class Wire:
    """A position in the bytes of one message; each method reads on from there."""

    __slots__ = ("_at", "_counter", "_data", "_double", "_float", "_header", "_is_cdr", "_order")

    def __init__(self, data: bytes, *, is_cdr: bool) -> None:
        self._data = data
        self._is_cdr = is_cdr
        self._order = "<"
        self._at = 0
        if is_cdr:
            if data[:2] not in _BYTE_ORDERS or len(data) < 4:
                raise MalformedMessageError("found no header of CDR, expected 00 00 or 00 01")
            self._order = _BYTE_ORDERS[data[:2]]
            self._at = 4
        self._counter, unsigned, signed, self._float, self._double = _ORDERS[self._order]
        self._header = signed if is_cdr else unsigned

    def count(self) -> int:
        """An unsigned number of 32 bits."""
        at = self._at
        if self._is_cdr:
            at = (at + 3) & ~3
        self._at = at + 4
        try:
            (value,) = self._counter.unpack_from(self._data, at)
        except struct.error:
            raise MalformedMessageError(f"found {len(self._data)} bytes, expected {self._at} or more") from None
        return int(value)

    def byte(self) -> int:
        """An unsigned number of 8 bits."""
        return self._bytes(1)[0]

    def raw(self, n: int) -> bytes:
        """So many bytes as they are."""
        return self._bytes(n)

    def header(self) -> tuple[float, str]:
        """The stamp [s] and the frame of a std_msgs/Header."""
        at = self._aligned(4) if self._is_cdr else self._at + 4  # behind a sequence number
        seconds, nanoseconds, length = self._unpack(self._header, at)
        return seconds + 1e-9 * nanoseconds, _frame_name(self._bytes(int(length)))

    def frame(self) -> str:
        """The name of a frame, without the leading slash of old."""
        return _frame_name(self._bytes(self.count()))

    def string(self) -> str:
        """A text."""
        text = self._bytes(self.count())
        if self._is_cdr:
            text = text.removesuffix(b"\0")
        return text.decode("utf-8", "replace")

    def doubles(self, n: int) -> tuple[float, ...]:
        """3, 4 or 7 numbers of 64 bits."""
        return self._unpack(_DOUBLES[self._order, n], self._aligned(8))

    def seven_floats(self) -> tuple[float, ...]:
        """Seven numbers of 32 bits."""
        return self._unpack(_FLOATS[self._order, 7], self._aligned(4))

    def skip_doubles(self, n: int) -> None:
        """Pass over n numbers of 64 bits."""
        self._at = self._aligned(8) + 8 * n

    def float_array(self) -> NDArray[np.float32]:
        """Numbers of 32 bits, preceded by how many they are; a copy."""
        n = self.count()
        if 4 * n > len(self._data) - self._at:
            raise MalformedMessageError(f"found room for {(len(self._data) - self._at) // 4} numbers, expected {n}")
        values = np.frombuffer(self._data, dtype=self._float, count=n, offset=self._at)
        self._at += 4 * n
        return values.astype(np.float32)

    def first_echoes(self) -> NDArray[np.float32]:
        """The first number of each of several lists, NaN for an empty one; preceded by how many lists they are."""
        n = self.count()
        words = np.frombuffer(self._data[self._at : self._at + ((len(self._data) - self._at) & ~3)], self._float)
        if n > len(words):
            raise MalformedMessageError(f"found room for {len(words)} beams, expected {n}")
        echoes, ranges = words.astype(np.float32), np.empty(n, dtype=np.float32)
        counts = words.view(self._float.str.replace("f", "u")).astype(np.uint32)
        taken = first_echoes(counts, echoes, ranges)
        if taken > len(words):
            raise MalformedMessageError(f"found {len(self._data)} bytes, expected the echoes of {n} beams")
        self._at += 4 * taken
        return ranges

    def _bytes(self, length: int) -> bytes:
        end = self._at + length
        if end > len(self._data):
            raise MalformedMessageError(f"found {len(self._data) - self._at} bytes, expected {length} more")
        text = self._data[self._at : end]
        self._at = end
        return text

    def _aligned(self, size: int) -> int:
        return ((self._at - 5 + size) // size) * size + 4 if self._is_cdr else self._at

    def _unpack(self, form: struct.Struct, at: int) -> tuple[float, ...]:
        self._at = at + form.size
        try:
            return form.unpack_from(self._data, at)
        except struct.error:
            raise MalformedMessageError(f"found {len(self._data)} bytes, expected {self._at} or more") from None


@lru_cache(256)
def _frame_name(name: bytes) -> str:
    return name.removesuffix(b"\0").decode("utf-8", "replace").lstrip("/")
