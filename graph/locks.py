"""Locks that end with the process that holds them, however it ends."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

if sys.platform != "win32":
    import fcntl


@contextmanager
def locked(path: Path, open_it: Callable[[], int]) -> Iterator[int]:
    """Hold the lock of a file or folder; wait while another process or thread holds it.

    Where the system or the file system has no such locks, nobody waits.

    Args:
        path: its path; may be removed or replaced by whoever held the lock before, then the new one is locked.
        open_it: opens it, and makes it first when it is missing.

    Yields:
        The file descriptor.

    Raises:
        OSError: it cannot be opened.
    """
    handle = _held(path, open_it)
    try:
        yield handle
    finally:
        os.close(handle)


def _held(path: Path, open_it: Callable[[], int]) -> int:
    while True:
        handle = open_it()
        try:
            _lock(handle)
            if _is_at(path, handle):
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _lock(handle: int) -> None:
    if sys.platform != "win32":
        with suppress(OSError):  # some network file systems
            fcntl.flock(handle, fcntl.LOCK_EX)


def _is_at(path: Path, handle: int) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False
