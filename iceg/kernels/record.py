"""The list of kernels, written anew from what runs call: `python -m iceg.kernels.record [LOG ...]`.

The embedded log always runs, with odometry and without; further logs add what only they need.
"""

import json
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba.core.dispatcher import Dispatcher

from frontends.logs import read_log
from iceg.demo import demo_log_path
from iceg.kernels.signatures import SIGNATURES, STAGES, plain_type
from iceg.pipeline import run
from iceg.results import write_results
from iceg.slam.progress import Progress


class Called(NamedTuple):
    """What a run called.

    Attributes:
        stages: by kernels, each its module, its name and the types of its arguments as one text, the stage of the run
            that called it first.
        is_compiled: whether kernels were compiled instead of loaded. What was compiled was compiled for a kernel that
            calls it, too: only a run that loads all kernels tells which ones Python calls.
    """

    stages: dict[str, str]
    is_compiled: bool


class _Noted:
    """Notes which kernels this process has called, whenever a stage of a run begins."""

    def __init__(self) -> None:
        self.stages: dict[str, str] = {}
        self._stage = "reading"

    def __call__(self, progress: Progress) -> None:
        if progress.stage != self._stage:
            self.begin(progress.stage)

    def begin(self, stage: str) -> None:
        """Note what was called until now, in the stage before."""
        for kernel in _kernels_in_use():
            self.stages.setdefault(json.dumps(kernel), self._stage)
        self._stage = stage


def called_by(path: Path, *, with_odometry: bool = True) -> Called:
    """Run a log and write its results, in a process that has called no kernel yet."""
    noted = _Noted()
    log = read_log(path)
    if not with_odometry:
        log = replace(log, odometry=np.zeros_like(log.odometry), has_odometry=False)
    result = run(log, progress=noted)
    noted.begin("writing")
    with tempfile.TemporaryDirectory() as folder:
        write_results(result, Path(folder) / "results")
    noted.begin("")
    return Called(noted.stages, _has_compiled())


def main() -> None:
    """Run everything, twice if it must compile, and write the list."""
    paths = [demo_log_path(), demo_log_path(), *map(Path, sys.argv[1:])]
    with_odometry = [True, False, *(True for _ in sys.argv[1:])]
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as one_process_a_log:
        runs = list(one_process_a_log.map(_called_by, paths, with_odometry))
    if any(called.is_compiled for called in runs):
        sys.exit("kernels were compiled: run this once more, so that only what Python calls is listed")
    stages: dict[str, str] = {}
    for called in runs:
        for kernel, stage in called.stages.items():
            stages[kernel] = min(stage, stages.get(kernel, stage), key=STAGES.index)
    rows = [json.dumps([stage, *json.loads(kernel)]) for kernel, stage in sorted(stages.items())]
    SIGNATURES.write_text("[\n" + ",\n".join(rows) + "\n]\n", encoding="utf-8")


def _called_by(path: Path, with_odometry: bool) -> Called:
    return called_by(path, with_odometry=with_odometry)


def _kernels_in_use() -> Iterator[tuple[str, str, list[object]]]:
    """Module, name and types of arguments of each kernel that this process has called, in order."""
    for module, name, kernel in _kernels():
        for arguments in kernel.signatures:
            yield module, name, [plain_type(argument) for argument in arguments]


def _has_compiled() -> bool:
    """Whether this process has compiled a kernel instead of loading it."""
    return any(kernel.stats.cache_misses for _, _, kernel in _kernels())


def _kernels() -> Iterator[tuple[str, str, Dispatcher]]:
    for module in sorted(name for name in sys.modules if name.split(".")[0] in ("graph", "frontends", "iceg")):
        for name, value in sorted(vars(sys.modules[module]).items()):
            if isinstance(value, Dispatcher) and value.py_func.__module__ == module:
                yield module, name, value


if __name__ == "__main__":
    main()
