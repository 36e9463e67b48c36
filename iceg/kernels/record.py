"""The list of kernels, written anew from what runs call: `python -m iceg.kernels.record [LOG ...]`.

The embedded log always runs, with odometry and without; further logs add what only they need.
"""

import json
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numba.core.dispatcher import Dispatcher

from frontends.logs import read_log
from frontends.scan import Log
from iceg.demo import demo_log_path
from iceg.kernels.signatures import SIGNATURES, plain_type
from iceg.results import write_results
from iceg.slam.pipeline import run


def kernels_in_use() -> Iterator[tuple[str, str, list[object]]]:
    """Module, name and types of arguments of each kernel that this process has called, in order.

    What the process has compiled was compiled for a kernel that calls it, too: only after a run that loads all kernels
    are these the ones that Python calls.
    """
    for module in sorted(name for name in sys.modules if name.split(".")[0] in ("graph", "frontends", "iceg")):
        for name, value in sorted(vars(sys.modules[module]).items()):
            if isinstance(value, Dispatcher) and value.py_func.__module__ == module:
                for arguments in value.signatures:
                    yield module, name, [plain_type(argument) for argument in arguments]


def run_through(logs: Iterable[Log]) -> None:
    """Run logs and write their results."""
    for log in logs:
        with tempfile.TemporaryDirectory() as folder:
            write_results(run(log), Path(folder) / "results")


def main() -> None:
    """Run everything, twice if it must compile, and write the list."""
    demo = read_log(demo_log_path())
    bare = replace(demo, odometry=np.zeros_like(demo.odometry), has_odometry=False)
    run_through([demo, bare, *map(read_log, map(Path, sys.argv[1:]))])
    if compiled_here():
        sys.exit("kernels were compiled: run this once more, so that only what Python calls is listed")
    rows = [json.dumps(row) for row in kernels_in_use()]
    SIGNATURES.write_text("[\n" + ",\n".join(rows) + "\n]\n", encoding="utf-8")


def compiled_here() -> bool:
    """Whether this process has compiled a kernel instead of loading it."""
    return any(
        value.stats.cache_misses
        for name, module in list(sys.modules.items())
        if name.split(".")[0] in ("graph", "frontends", "iceg")
        for value in vars(module).values()
        if isinstance(value, Dispatcher)
    )


if __name__ == "__main__":
    main()
