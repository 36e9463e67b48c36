"""Opening files that somebody gave: regular ones only, and none larger than its limit."""

import os
import stat
from pathlib import Path

from graph.errors import IcegError, reason
from graph.limits import LimitError, check_limit

_LONGEST = 500  # characters of a path in a message


def check_file(path: Path, limit: str | None, error: type[IcegError], what: str) -> None:
    """Refuse what is no regular file (a folder, a device, a pipe nobody may write to) or too large.

    Args:
        path: the file.
        limit: the field of `graph.limits.Limits` that bounds its bytes; None where it may have any size.
        error: raised where it is refused.
        what: for the message: "cannot be read as" what.

    Raises:
        IcegError: of the type given.
    """
    try:
        status = path.stat()
    except (OSError, ValueError) as err:
        raise error(f"{shown(path)}: cannot be read as {what}: {reason(err)}") from err
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or pipe"
        raise error(f"{path}: cannot be read as {what}: found {kind}, expected a file")
    if limit is None:
        return
    try:
        check_limit(status.st_size, limit, f"{path}: cannot be read as {what}: found {status.st_size} bytes")
    except LimitError as err:
        raise error(str(err)) from err


def read_text(path: Path, limit: str, error: type[IcegError], what: str, encoding: str = "utf-8-sig") -> str:
    """All of a small text file.

    Args:
        path: the file.
        limit: as for `check_file`.
        error: likewise.
        what: likewise.
        encoding: of its text.

    Raises:
        IcegError: of the type given.
    """
    check_file(path, limit, error, what)
    try:
        return path.read_text(encoding=encoding)
    except (OSError, ValueError) as err:
        raise error(f"{path}: cannot be read as {what}: {reason(err)}") from err


def shown(path: Path | str) -> str:
    """A path for messages: one that no file system has may hold anything."""
    text = os.fsdecode(path)
    text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
    return text if text.isprintable() else repr(text)[1:-1]
