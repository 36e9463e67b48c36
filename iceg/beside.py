"""Two things at the same time, where the machine has a second processor."""

import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar, cast

_Result = TypeVar("_Result")


def has_second_processor() -> bool:
    """Whether this process may use more than one processor."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0)) > 1
    return (os.cpu_count() or 1) > 1


def may_fork() -> bool:
    """Whether a copy of this process is safe and worth it: on Linux, without other threads, with a second processor."""
    return sys.platform == "linux" and threading.active_count() == 1 and has_second_processor()


class InThread(threading.Thread, Generic[_Result]):
    """Work that goes on in a thread: worth it for compiled loops that leave the interpreter to others meanwhile."""

    def __init__(self, work: Callable[[], _Result]) -> None:
        """Begin, or leave it for later where there is no second processor."""
        super().__init__(daemon=True)
        self._work = work
        self._found: list[_Result] = []
        self._error: BaseException | None = None
        self._is_begun = has_second_processor()
        if self._is_begun:
            self.start()

    def run(self) -> None:
        """Do the work; `result` tells what came of it."""
        try:
            self._found.append(self._work())
        except BaseException as err:  # noqa: BLE001 raised again where the result is asked for
            self._error = err

    def result(self) -> _Result:
        """What the work returned, once it is done; what it raised is raised here."""
        if self._is_begun:
            self.join()
        else:
            self.run()
        if self._error is not None:
            raise self._error
        return self._found[0]


@contextmanager
def in_second_process(work: Callable[[], _Result]) -> Iterator[Callable[[], _Result]]:
    """Do some work in a copy of this process, while the block goes on; here, when it is asked for, where none may be.

    Args:
        work: what it returns or raises must be fit for pickle; whatever else it changes in memory is lost.

    Yields:
        What waits for the work and returns what it returned, or raises what it raised.

    Raises:
        ChildProcessError: the copy ended without a word.
    """
    if not may_fork():
        yield work
        return
    reading, writing = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _tell(work, writing)
    os.close(writing)
    waiting = [child]

    def result() -> _Result:
        with os.fdopen(os.dup(reading), "rb") as stream:
            content = stream.read()
        os.waitpid(waiting.pop(), 0)
        if not content:
            raise ChildProcessError("a second process ended before its work was done")
        found, error = pickle.loads(content)  # noqa: S301 its own copy wrote it
        if error is not None:
            raise error
        return cast("_Result", found)

    try:
        yield result
    finally:
        os.close(reading)
        if waiting:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def _tell(work: Callable[[], object], writing: int) -> None:
    """Do the work in the copy, write what came of it into the pipe, and end."""
    code = 1
    try:
        try:
            told = pickle.dumps((work(), None))
        except BaseException as err:  # noqa: BLE001 raised again where the result is asked for
            told = pickle.dumps((None, err))
        with os.fdopen(writing, "wb") as stream:
            stream.write(told)
        code = 0
    finally:  # nothing of what the original would do at its end
        os._exit(code)
