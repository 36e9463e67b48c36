"""The decompressors that bags need, and reading the beginning of what is damaged."""

import bz2
import sys
from collections.abc import Callable, Iterator
from typing import Protocol

import lz4.frame

from frontends.bags.errors import MalformedMessageError
from frontends.bags.magic import ZSTD
from graph.limits import LIMITS, at_most

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
    """Unpack a chunk as far as it goes, and no farther than a log may.

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
    size = 0
    try:
        for at in range(0, len(data), _BLOCK):
            pieces.append(decompressor.decompress(data[at : at + _BLOCK]))
            size += len(pieces[-1])
            if size > LIMITS.log_bytes:
                return b"".join(pieces), False
    except (OSError, EOFError, RuntimeError, ValueError, zstd.ZstdError):
        return b"".join(pieces), False
    return b"".join(pieces), True


def unpacked_message(data: bytes) -> bytes:
    """A ROS 2 message that may have been packed on its own: CDR begins with a zero, zstd does not.

    Raises:
        MalformedMessageError: it cannot be unpacked, or is larger than a log may be.
    """
    if not data.startswith(ZSTD):
        return data
    try:
        return b"".join(_frames(data))
    except (zstd.ZstdError, EOFError, ValueError, MemoryError) as error:
        raise MalformedMessageError(f"it cannot be unpacked ({error})") from error


def _frames(data: bytes) -> Iterator[bytes]:
    """What each frame of packed bytes holds."""
    room = LIMITS.log_bytes
    while data:
        decompressor = zstd.ZstdDecompressor()
        content = decompressor.decompress(data, room + 1)
        room -= len(content)
        if room < 0:
            raise MalformedMessageError(f"found more bytes when unpacked, expected {at_most('log_bytes')}")
        if not decompressor.eof:
            raise EOFError("it ends before its last frame does")
        yield content
        data = decompressor.unused_data
