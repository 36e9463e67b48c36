"""Text logs as a stream of lines, plain or compressed (gz, bz2, xz, told by their first bytes)."""

import bz2
import codecs
import gzip
import lzma
import zlib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from frontends.logs.ahead import ahead
from frontends.logs.errors import LogError
from graph.errors import reason
from graph.files import check_file
from graph.limits import LIMITS, at_most

_BLOCK_BYTES = 1 << 20
OPENERS = ((b"\x1f\x8b", gzip.open), (b"BZh", bz2.open), (b"\xfd7zXZ\x00", lzma.open))
"""How compressed files begin, and what opens them."""


class Line(NamedTuple):
    """One line, as a stretch of the block it was read with, so that nothing is copied.

    Attributes:
        number: counted from 1.
        block: the text around it.
        bytes_of_block: the same as a (n,) uint8 array.
        start: where the line begins in the block.
        stop: where it ends, without its newline.
        terminated: False for a last line without newline, which may have been cut off.
    """

    number: int
    block: bytes
    bytes_of_block: NDArray[np.uint8]
    start: int
    stop: int
    terminated: bool

    @property
    def text(self) -> bytes:
        """The line itself."""
        return self.block[self.start : self.stop]


class Block(NamedTuple):
    """Whole lines of a text.

    Attributes:
        text: the lines.
        bytes: the same as a (n,) uint8 array.
        terminated: False for what follows the last newline, which may have been cut off.
    """

    text: bytes
    bytes: NDArray[np.uint8]
    terminated: bool

    def line(self, number: int, start: int) -> Line:
        """The line that begins at `start`, counted from 1 in the whole text."""
        stop = self.text.find(b"\n", start)
        return Line(number, self.text, self.bytes, start, len(self.text) if stop < 0 else stop, self.terminated)


class TextLog:
    """A text log, read block by block.

    Attributes:
        path: the file.
        cut_off: whether the compressed stream turned out to end before its end mark.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cut_off = False

    def blocks(self) -> Iterator[Block]:
        """All lines in file order, many at once.

        Raises:
            LogError: the file is missing, unreadable or too large, or its compressed content is damaged.
        """
        for text, terminated in self._whole_lines():
            yield Block(text, np.frombuffer(text, dtype=np.uint8), terminated)

    def head(self, size: int = 1 << 16) -> bytes:
        """Up to `size` bytes of the uncompressed beginning, to tell the format by."""
        head = bytearray()
        for chunk in self._chunks():
            head += chunk
            if len(head) >= size:
                break
        return bytes(head[:size])

    def _whole_lines(self) -> Iterator[tuple[bytes, bool]]:
        """Blocks that end with a newline, and at last what follows the last newline."""
        pending: list[bytes] = []
        for chunk in ahead(self._joined_chunks()):
            cut = chunk.rfind(b"\n") + 1
            if cut == 0:
                pending.append(chunk)
                self._check_line(sum(map(len, pending)))
                continue
            yield b"".join([*pending, chunk[:cut]]), True
            pending = [chunk[cut:]]
        yield b"".join(pending), False

    def _joined_chunks(self) -> Iterator[bytes]:
        """The chunks together as blocks that are worth a pass each."""
        chunks: list[bytes] = []
        try:
            for chunk in self._chunks():
                chunks.append(chunk)
                if sum(map(len, chunks)) >= _BLOCK_BYTES:
                    yield b"".join(chunks)
                    chunks.clear()
        except LogError:
            yield b"".join(chunks)  # what comes before the damage is read before it is told
            raise
        yield b"".join(chunks)

    def _check_line(self, size: int) -> None:
        if size > LIMITS.line_bytes:
            raise LogError(f"{self.path}: found a line of {size} bytes or more, expected {at_most('line_bytes')}")

    def _chunks(self) -> Iterator[bytes]:
        check_file(self.path, "log_bytes", LogError, "a log")
        unpacked = 0
        try:
            with closing(_open(self.path)) as stream:
                yield stream.read1(_BLOCK_BYTES).removeprefix(codecs.BOM_UTF8)
                while chunk := stream.read1(_BLOCK_BYTES):
                    unpacked += len(chunk)
                    if unpacked > LIMITS.log_bytes:
                        raise LogError(f"{self.path}: found a longer text, expected {at_most('log_bytes')} bytes")
                    yield chunk
        except EOFError:
            self.cut_off = True
        except (zlib.error, lzma.LZMAError, gzip.BadGzipFile) as error:
            raise LogError(f"{self.path}: its compressed content is damaged ({error})") from error
        except OSError as error:
            raise LogError(f"{self.path}: cannot be read ({reason(error)})") from error


class _Stream(BinaryIO):
    def read1(self, size: int) -> bytes: ...  # type: ignore[empty-body]


def _open(path: Path) -> _Stream:
    with path.open("rb") as raw:
        magic = raw.read(6)
    for signature, opener in OPENERS:
        if magic.startswith(signature):
            return cast("_Stream", opener(path, "rb"))
    return cast("_Stream", path.open("rb"))
