"""PNG files of large plain pictures.

Pillow tries five filters on every row, which suits photographs. Walls, strokes and even areas come out smaller without
any, and in a third of the time.
"""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_BITS, _RGB = 8, 2
_LEVEL = 3
"""Of zlib's nine, the last of its fast ones."""
_METRES_PER_INCH = 0.0254


def encode_png(pixels: NDArray[np.uint8], *, dots_per_inch: float) -> bytes:
    """The bytes of a PNG file (the format: W3C, Portable Network Graphics).

    Args:
        pixels: (height, width, 3) red, green and blue, from the top.
        dots_per_inch: the size at which the picture wants to be shown.
    """
    height, width, _ = pixels.shape
    rows = np.zeros((height, 1 + 3 * width), dtype=np.uint8)  # each row begins with its filter: 0 for none
    rows[:, 1:] = pixels.reshape(height, 3 * width)
    per_metre = round(dots_per_inch / _METRES_PER_INCH)
    return b"".join(
        [
            _SIGNATURE,
            _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, _BITS, _RGB, 0, 0, 0)),
            _chunk(b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)),
            _chunk(b"IDAT", zlib.compress(rows.data, _LEVEL)),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
