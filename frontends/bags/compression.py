"""The decompressors that bags need, and reading the beginning of what is damaged."""

import bz2
import sys
from collections.abc import Callable
from typing import Protocol

import lz4.frame

from frontends.bags.errors import MalformedMessageError
from frontends.bags.magic import ZSTD

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = ["unpacked_beginning", "unpacked_message", "zstd"]

_BLOCK = 1 << 14
"""Bytes unpacked at a time: so much may be lost before the damage."""


class _Decompressor(Protocol):
    def decompress(self, data: bytes, /) -> bytes: ...


_DECOMPRESSORS: dict[str, Callable[[], _Decompressor]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}
"""ROS 1 knows bz2 and lz4, MCAP lz4 and zstd."""


def unpacked_beginning(compression: str, data: bytes) -> tuple[bytes, bool]:
    """Unpack a chunk as far as it goes.

    Args:
        compression: as the chunk states it.
        data: the packed bytes.

    Returns:
        What could be unpacked, and whether that is all.
    """
    if compression in {"", "none"}:
        return data, True
    if compression not in _DECOMPRESSORS:
        return b"", False
    decompressor = _DECOMPRESSORS[compression]()
    pieces: list[bytes] = []
    try:
        pieces.extend(decompressor.decompress(data[at : at + _BLOCK]) for at in range(0, len(data), _BLOCK))
    except (OSError, EOFError, RuntimeError, ValueError, zstd.ZstdError):
        return b"".join(pieces), False
    return b"".join(pieces), True


def unpacked_message(data: bytes) -> bytes:
    """A ROS 2 message that may have been packed on its own: CDR begins with a zero, zstd does not.

    Raises:
        MalformedMessageError: it cannot be unpacked.
    """
    if not data.startswith(ZSTD):
        return data
    try:
        return zstd.decompress(data)
    except (zstd.ZstdError, EOFError, ValueError, MemoryError) as error:
        raise MalformedMessageError(f"it cannot be unpacked ({error})") from error
