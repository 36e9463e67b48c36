"""The decompressors that bags need, by the name that a chunk states."""

import bz2
import sys
from collections.abc import Callable

import lz4.frame

from frontends.bags.magic import ZSTD

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = ["DECOMPRESSORS", "unpacked_message", "zstd"]

DECOMPRESSORS: dict[str, Callable[[bytes], bytes]] = {
    "": bytes,
    "none": bytes,
    "bz2": bz2.decompress,
    "lz4": lz4.frame.decompress,
    "zstd": zstd.decompress,
}
"""ROS 1 knows none, bz2 and lz4, MCAP "", lz4 and zstd."""


def unpacked_message(data: bytes) -> bytes:
    """A ROS 2 message that may have been packed on its own: CDR begins with a zero, zstd does not."""
    return zstd.decompress(data) if data.startswith(ZSTD) else data
