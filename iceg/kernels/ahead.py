"""Compiling every listed kernel before the first run, in as many processes as there are processors."""

import contextlib
import hashlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Self

from graph.locks import locked
from iceg.kernels.signatures import SIGNATURES, listed_kernels

_ROOT = Path(__file__).parent.parent.parent
_WORKER = "iceg.kernels.worker"
_GROUPS = (
    (
        "iceg.ice._point_kernels",
        "iceg.ice._refinement_kernels",
        "iceg.ice._score_kernels",
        "iceg.ice._tracking_kernels",
    ),
    ("iceg.maps._landmark_kernels",),
    ("iceg.ice._agreement_kernels", "iceg.ice._feature_kernels"),
    ("iceg.maps._grid_kernels",),
    ("graph._sparse_kernels",),
    ("iceg.slam.sweep._pair_kernels",),
)
"""Modules that one process compiles in a row, as they share what they call; those that take longest are begun first, so
that all processes end together. Every other module is a group of its own …"""
_LAST = ("frontends.logs._number_kernels", "frontends.logs._sweep_kernels")
"""… and these come last: by then the process that reads a log meanwhile has compiled what it needs of them."""
_NO_COLOURS = {"NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING": "1"}
"""Where colorama is installed, numba would colour a message for each overload it tries in vain: 3 % of the time."""

Told = Callable[[int, int], None]
"""Called with how many kernels are compiled, and how many there are."""


def compile_ahead(told: Told | None = None) -> None:
    """Compile all listed kernels that are not kept on disk yet; at once where that was done before.

    Args:
        told: called as kernels are compiled.
    """
    with compiling_ahead() as wait:
        wait(told)


@contextlib.contextmanager
def compiling_ahead() -> Iterator[Callable[[Told | None], None]]:
    """Compile all listed kernels that are not kept on disk yet, while the block goes on until it waits for them.

    Kernels are kept for one processor, version of Python, of numba and of the source. Where nothing can be kept, the
    run compiles what it needs.

    Yields:
        What waits until all are compiled, and tells of each to what it is given. What is not compiled by the end of the
        block is left.
    """
    mark = _mark()
    with contextlib.ExitStack() as stack:
        compiling = None if mark is None or mark.exists() else _begin(mark, stack)

        def wait(told: Told | None = None) -> None:
            if mark is not None and compiling is not None and compiling.finish(told):
                with contextlib.suppress(OSError):
                    mark.touch()
            stack.close()

        yield wait


def _begin(mark: Path, stack: contextlib.ExitStack) -> "_Compiling | None":
    """Processes that compile until the stack is closed; None where another process has compiled all, or none can."""
    try:
        mark.parent.mkdir(parents=True, exist_ok=True)
        lock = mark.with_name("listed.lock")
        stack.enter_context(locked(lock, lambda: os.open(lock, os.O_RDWR | os.O_CREAT)))
        return None if mark.exists() else stack.enter_context(_Compiling())
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
    modules = {_ROOT.joinpath(*kernel.module.split(".")).with_suffix(".py") for kernel in listed_kernels()}
    for source in (SIGNATURES, *sorted(modules)):
        state = source.stat()
        known.update(f"{source} {state.st_mtime_ns} {state.st_size}".encode())
    return Path(kept) / f"listed-{known.hexdigest()}.compiled"


class _Compiling:
    """Processes that compile all kernels, each with a thread that hands it group after group. A context manager."""

    def __init__(self) -> None:
        self._groups: SimpleQueue[list[int]] = SimpleQueue()
        self._answers: SimpleQueue[bool | None] = SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._workers = contextlib.ExitStack()

    def __enter__(self) -> Self:
        for group in _groups():
            self._groups.put(group)
        with contextlib.ExitStack() as workers:
            for _ in range(min(processors(), self._groups.qsize())):
                worker = workers.enter_context(_worker())
                feeding = (worker, self._groups, self._answers)
                self._threads.append(threading.Thread(target=_feed, args=feeding, daemon=True))
            self._workers = workers.pop_all()
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._workers.close()
        for thread in self._threads:  # a process that has threads must not be copied
            thread.join()

    def finish(self, told: Told | None) -> bool:
        """Tell of each kernel until all processes have ended; whether all were compiled."""
        n_kernels = len(listed_kernels())
        working, done, compiled = len(self._threads), 0, 0
        while working:
            answer = self._answers.get()
            if answer is None:
                working -= 1
                continue
            done, compiled = done + 1, compiled + answer
            if told is not None:
                told(done, n_kernels)
        return compiled == n_kernels


def _groups() -> list[list[int]]:
    """Which kernels one process compiles in a row, by their places in the list."""
    first = {module: modules for modules in _GROUPS for module in modules}
    groups: dict[tuple[str, ...], list[int]] = {modules: [] for modules in _GROUPS}
    last: list[list[int]] = []
    for place, kernel in enumerate(listed_kernels()):
        if kernel.module in _LAST:
            last.append([place])
        else:
            groups.setdefault(first.get(kernel.module, (kernel.module,)), []).append(place)
    return [*filter(None, groups.values()), *last]


def _feed(
    worker: "subprocess.Popen[str]", groups: "SimpleQueue[list[int]]", answers: "SimpleQueue[bool | None]"
) -> None:
    """Hand a process group after group, and pass on what it says; None when it has ended or nothing is left."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    try:
        while True:
            group = groups.get_nowait()
            worker.stdin.write(f"{json.dumps(group)}\n")
            worker.stdin.flush()
            for _ in group:
                line = worker.stdout.readline()
                if not line:
                    return
                answers.put(line.strip() == "compiled")
    except (Empty, OSError):
        pass
    finally:
        worker.stdout.close()
        with contextlib.suppress(OSError):  # it has ended, and does not take what is left to say
            worker.stdin.close()
        answers.put(None)


@contextlib.contextmanager
def _worker() -> "Iterator[subprocess.Popen[str]]":
    """A process that compiles; it ends with the block."""
    paths = [str(_ROOT), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", _WORKER],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths), **_NO_COLOURS},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        encoding="utf-8",
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
