"""Files that are complete or not there at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from graph.locks import locked


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A stream under a temporary name in the file's folder, moved into place when the block ends without an error.

    Whatever ends the process, a power cut included, there is the whole old file or the whole new one. What a killed
    process has left under the temporary name is taken over by the next one to write the same file; of two at a time
    the second waits.

    Args:
        path: the file; replaced when it exists.

    Raises:
        OSError: the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.iceg-partial")

    def open_it() -> int:
        try:
            flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
            return os.open(temporary, flags, 0o666)
        except OSError as err:
            err.filename = str(path)  # nobody has asked for the temporary one
            raise

    with locked(temporary, open_it) as handle:
        try:
            os.ftruncate(handle, 0)
            with os.fdopen(handle, "wb", closefd=False) as stream:
                yield stream
                stream.flush()
                os.fsync(handle)
            _move(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        sync_folder(path.parent)


def write_atomically(path: Path, content: bytes) -> None:
    """Write all of a file at once, see `replacing`."""
    with replacing(path) as stream:
        stream.write(content)


def _move(temporary: Path, path: Path) -> None:
    try:
        temporary.replace(path)
    except OSError as err:
        if err.filename is None:
            raise
        raise OSError(err.errno, err.strerror, str(path)) from err  # nobody has asked for the temporary one


def sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk, as far as the file system can tell."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # folders cannot be opened everywhere
        return
    try:
        os.fsync(handle)
    except OSError:  # nor synchronised
        pass
    finally:
        os.close(handle)
