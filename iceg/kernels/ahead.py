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

from graph.locks import locked
from iceg.kernels.signatures import SIGNATURES, listed_kernels

_ROOT = Path(__file__).parent.parent.parent
_WORKER = "iceg.kernels.worker"
_GROUPS = (
    (
        "iceg.ice._agreement_kernels",
        "iceg.ice._feature_kernels",
        "iceg.ice._point_kernels",
        "iceg.ice._refinement_kernels",
        "iceg.ice._score_kernels",
        "iceg.ice._tracking_kernels",
    ),
    ("iceg.maps._landmark_kernels",),
    ("iceg.maps._grid_kernels",),
    ("graph._sparse_kernels",),
)
"""Modules that one process compiles in a row, as they share what they call; those that take longest are begun first, so
that all processes end together. Every other module is a group of its own."""

Told = Callable[[int, int], None]
"""Called with how many kernels are compiled, and how many there are."""


def compile_ahead(told: Told | None = None) -> None:
    """Compile all listed kernels that are not kept on disk yet; at once where that was done before.

    Kernels are kept for one processor, version of Python, of numba and of the source. Where nothing can be kept, the
    run compiles what it needs.

    Args:
        told: called as kernels are compiled.
    """
    mark = _mark()
    if mark is None or mark.exists():
        return
    with contextlib.suppress(OSError):  # a full disk, say: where nothing can be kept, the run compiles what it needs
        mark.parent.mkdir(parents=True, exist_ok=True)
        lock = mark.with_name("listed.lock")
        with locked(lock, lambda: os.open(lock, os.O_RDWR | os.O_CREAT)):
            if not mark.exists() and _compile_in_processes(told):
                mark.touch()


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


def _compile_in_processes(told: Told | None) -> bool:
    """Whether every kernel was compiled."""
    groups: SimpleQueue[list[int]] = SimpleQueue()
    for group in _groups():
        groups.put(group)
    answers: SimpleQueue[bool | None] = SimpleQueue()
    n = min(processors(), groups.qsize())
    with contextlib.ExitStack() as stack:
        for _ in range(n):
            worker = stack.enter_context(_worker())
            threading.Thread(target=_feed, args=(worker, groups, answers), daemon=True).start()
        return _count(answers, n, told)


def _count(answers: "SimpleQueue[bool | None]", n_workers: int, told: Told | None) -> bool:
    """Tell of each kernel until all workers have ended; whether all were compiled."""
    n_kernels = len(listed_kernels())
    done = compiled = 0
    while n_workers:
        answer = answers.get()
        if answer is None:
            n_workers -= 1
            continue
        done, compiled = done + 1, compiled + answer
        if told is not None:
            told(done, n_kernels)
    return compiled == n_kernels


def _groups() -> list[list[int]]:
    """Which kernels one process compiles in a row, by their places in the list."""
    rank = {module: k for k, modules in enumerate(_GROUPS) for module in modules}
    groups: dict[int | str, list[int]] = {k: [] for k in range(len(_GROUPS))}
    for place, kernel in enumerate(listed_kernels()):
        groups.setdefault(rank.get(kernel.module, kernel.module), []).append(place)
    return [places for places in groups.values() if places]


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
        answers.put(None)


@contextlib.contextmanager
def _worker() -> "Iterator[subprocess.Popen[str]]":
    """A process that compiles; it ends with the block."""
    paths = [str(_ROOT), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", _WORKER],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        encoding="utf-8",
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def processors() -> int:
    """How many this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not every system has it
        return os.cpu_count() or 1
