"""Compiling every listed kernel before the first run calls it, in as many processes as there are processors."""

import contextlib
import hashlib
import io
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from graph import compiled
from graph.locks import locked
from iceg.kernels.groups import ORDER, groups_of
from iceg.kernels.signatures import SIGNATURES, listed_kernels
from iceg.slam.progress import Progress, ProgressCallback

_ROOT = Path(__file__).parent.parent.parent
_WORKER = "iceg.kernels.worker"
_HOW = Path(compiled.__file__)
_NO_COLOURS = {"NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING": "1"}
"""Where colorama is installed, numba would colour a message for each overload it tries in vain: 3 % of the time."""

Told = Callable[[int, int], None]
"""Called with how many of the kernels that are waited for are compiled, and how many these are."""


def compile_ahead(told: Told | None = None) -> None:
    """Compile all listed kernels that are not kept on disk yet; at once where that was done before.

    Args:
        told: called as kernels are compiled.
    """
    with compiling_ahead() as kernels:
        kernels.wait(told)


@contextlib.contextmanager
def compiling_ahead() -> "Iterator[KernelsAhead]":
    """Compile all listed kernels that are not kept on disk yet, while the block goes on until it waits for them.

    Kernels are kept for one processor, version of Python, of numba and of the source. Where nothing can be kept, the
    run compiles what it needs.

    Yields:
        What waits for them. What is not compiled by the end of the block is left.
    """
    with contextlib.ExitStack() as stack:
        mark = _mark()
        answers = None if mark is None or mark.exists() else _begin(mark, stack)
        yield KernelsAhead(mark, answers, stack)


class KernelsAhead:
    """The listed kernels, which other processes compile where that is due."""

    def __init__(self, mark: Path | None, answers: io.RawIOBase | None, compiling: contextlib.ExitStack) -> None:
        """See `compiling_ahead`.

        Args:
            mark: a file to make when all are compiled.
            answers: through which the processes tell of each; None when there is nothing to wait for.
            compiling: what is closed then.
        """
        self._mark = mark
        self._answers = answers
        self._compiling = compiling
        self._answered: dict[int, bool] = {}
        self._stage = ""

    def wait(self, told: Told | None = None) -> None:
        """Wait until all are compiled."""
        self.wait_for(ORDER[-1], told)

    def wait_for(self, stage: str, told: Told | None = None) -> None:
        """Wait until those are compiled that a run calls in a stage, or before.

        Args:
            stage: one of `iceg.slam.progress`.
            told: called as kernels are compiled.
        """
        called = ORDER[: ORDER.index(stage) + 1]
        needed = {place for place, kernel in enumerate(listed_kernels()) if kernel.stage in called}
        while self._answers is not None and not needed <= self._answered.keys():
            if told is not None:
                told(len(needed & self._answered.keys()), len(needed))
            self._listen(self._answers)
            if told is not None:
                told(len(needed & self._answered.keys()), len(needed))

    def before_each_stage(self, progress: ProgressCallback | None, told: Told | None = None) -> ProgressCallback | None:
        """What a run is to call as it proceeds, so that each stage waits for its kernels.

        Args:
            progress: called then.
            told: called as kernels are compiled.
        """
        if self._answers is None:
            return progress

        def waited(now: Progress) -> None:
            if now.stage != self._stage:
                self._stage = now.stage
                self.wait_for(now.stage, told)
            if progress is not None:
                progress(now)

        return waited

    def _listen(self, answers: io.RawIOBase) -> None:
        """Take what is said of one kernel; after the last, or where all processes have died, nothing is waited for."""
        answer = answers.read(2)
        if answer:
            place, is_compiled = answer
            self._answered[place] = bool(is_compiled)
        is_complete = len(self._answered) == len(listed_kernels())
        if is_complete and all(self._answered.values()) and self._mark is not None:
            with contextlib.suppress(OSError):
                self._mark.touch()
        if is_complete or not answer:
            self._answers = None
            self._compiling.close()


def _begin(mark: Path, stack: contextlib.ExitStack) -> io.RawIOBase | None:
    """Processes that compile until the stack is closed; None where another process has compiled all, or none can."""
    try:
        mark.parent.mkdir(parents=True, exist_ok=True)
        lock = mark.with_name("listed.lock")
        stack.enter_context(locked(lock, lambda: os.open(lock, os.O_RDWR | os.O_CREAT)))
        return None if mark.exists() else stack.enter_context(_workers())
    except OSError:  # a full disk, say: where nothing can be kept, the run compiles what it needs
        return None


def _mark() -> Path | None:
    """A file that says that all kernels are compiled: for this machine, these sources. None where none can be kept."""
    import numba
    from numba.core.registry import cpu_target

    from graph._assign_kernels import assign

    kept = getattr(getattr(assign, "_cache", None), "cache_path", None)
    if kept is None or not sys.executable:
        return None
    known = hashlib.blake2b(digest_size=12)
    known.update(repr((sys.version, numba.__version__, cpu_target.target_context.codegen().magic_tuple())).encode())
    folders = {_ROOT.joinpath(*kernel.module.split(".")[:-1]) for kernel in listed_kernels()}
    called = [source for folder in sorted(folders) for source in sorted(folder.glob("*_kernels.py"))]
    for source in (SIGNATURES, _HOW, *called):
        state = source.stat()
        known.update(f"{source} {state.st_mtime_ns} {state.st_size}".encode())
    return Path(kept) / f"listed-{known.hexdigest()}.compiled"


@contextlib.contextmanager
def _workers() -> Iterator[io.RawIOBase]:
    """Processes that compile all kernels.

    They share two pipes: each takes the number of the next group from the one as it has time, which is a byte, and
    tells of each kernel through the other. No thread looks after them: a process that has threads must not be copied.

    Yields:
        The end of the pipe where their answers come out, and an end of file when all of them have ended.
    """
    groups = bytes(range(len(groups_of(listed_kernels()))))
    with contextlib.ExitStack() as kept:
        with contextlib.ExitStack() as handed_over:
            tasks, all_tasks = _pipe(handed_over, handed_over)
            answers, all_answers = _pipe(kept, handed_over)
            all_tasks.write(groups)
            for _ in range(min(processors(), len(groups))):
                kept.enter_context(_worker(tasks, all_answers))
        yield answers


def _pipe(keeps_reading: contextlib.ExitStack, keeps_writing: contextlib.ExitStack) -> tuple[io.FileIO, io.FileIO]:
    """The ends of a pipe, each closed with a stack."""
    reading, writing = os.pipe()
    return keeps_reading.enter_context(io.FileIO(reading)), keeps_writing.enter_context(io.FileIO(writing, "w"))


@contextlib.contextmanager
def _worker(tasks: io.FileIO, answers: io.FileIO) -> "Iterator[subprocess.Popen[bytes]]":
    """A process that compiles; it ends with the block."""
    paths = [str(_ROOT), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", _WORKER],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths), **_NO_COLOURS},
        stdin=tasks,
        stdout=answers,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def processors() -> int:
    """How many this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not every system has it
        return os.cpu_count() or 1
