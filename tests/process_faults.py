"""A layer under what writes files: every call that changes them is numbered, and the process ends at one of them."""

import errno
import itertools
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from graph.errors import IcegError

CALLS = ("open", "write", "ftruncate", "fsync", "mkdir", "rmdir", "link", "symlink", "rename", "replace", "unlink")
Fault = Literal["kill", "error", "signal"]

_DONE, _KILLED, _RAISED = 0, 77, 78


def ends_at(number: int, fault: Fault, act: Callable[[], object]) -> bool:
    """Do something in a fork of this process, with a fault at its call of that number.

    Args:
        number: from 0.
        fault: the process is killed; or this call fails as on a full disk; or a signal arrives before it.
        act: what to do.

    Returns:
        Whether there is a call of that number.
    """
    child = os.fork()
    if child == 0:
        os._exit(_act_with_fault(number, fault, act))
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in (_DONE, _KILLED, _RAISED), code
    return code != _DONE


def _act_with_fault(number: int, fault: Fault, act: Callable[[], object]) -> int:
    numbers = itertools.count()
    signal.signal(signal.SIGTERM, signal.default_int_handler)

    def faulty(call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any, **options: Any) -> Any:
            if next(numbers) == number:
                if fault == "kill":
                    os._exit(_KILLED)
                if fault == "error":
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                signal.raise_signal(signal.SIGTERM)
            return call(*arguments, **options)

        return counted

    for name in CALLS:
        setattr(os, name, faulty(getattr(os, name)))
    try:
        act()
    except (OSError, IcegError, KeyboardInterrupt):
        return _RAISED
    return _DONE if next(numbers) <= number else _RAISED  # where the error is of no consequence


def write_by_parts(path: Path, content: bytes) -> None:
    """Write a file in two calls, so that a fault may leave half of it."""
    handle = os.open(path, os.O_WRONLY | os.O_CREAT)
    middle = len(content) // 2
    os.write(handle, content[:middle])
    os.write(handle, content[middle:])
    os.close(handle)
