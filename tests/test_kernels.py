"""The list of kernels that are compiled before the first run."""

import json
import os
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from numba import from_dtype, types

from iceg.kernels import ahead
from iceg.kernels.signatures import Kernel, listed_kernels, plain_type, type_of

pytestmark = pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")

CALLED = """
import json, sys
from pathlib import Path
from iceg.demo import demo_log_path
from iceg.kernels import record
from frontends.logs import read_log
record.run_through([read_log(demo_log_path())])
json.dump([list(record.kernels_in_use()), record.compiled_here()], sys.stdout)
"""


def test_types_survive_the_list() -> None:
    for kernel in listed_kernels():
        for argument in kernel.arguments:
            assert plain_type(type_of(argument)) == argument


def test_what_the_list_has_no_words_for_is_refused() -> None:
    with pytest.raises(ValueError, match="expected numbers, arrays and tuples"):
        plain_type(types.unicode_type)
    with pytest.raises(ValueError, match="expected one of iceg"):
        plain_type(from_dtype(np.dtype([("weight", np.float64)]))[:])
    with pytest.raises((AttributeError, TypeError)):
        type_of("no_type")


def test_each_kernel_is_listed_for_one_kind_of_arguments_or_few() -> None:
    """More mean that a caller hands over arrays of another layout: it costs the time to compile again."""
    count = Counter((kernel.module, kernel.name) for kernel in listed_kernels())
    assert max(count.values()) <= 2, count.most_common(3)


def test_a_run_calls_what_is_listed_and_compiles_nothing() -> None:
    """Once all are compiled; `python -m iceg.kernels.record` renews the list."""
    ahead.compile_ahead()
    done = subprocess.run([sys.executable, "-c", CALLED], capture_output=True, text=True, check=True)
    called, compiled = json.loads(done.stdout)
    listed = [list(kernel) for kernel in listed_kernels()]
    assert [kernel for kernel in called if kernel not in listed] == []
    assert not compiled


def test_nothing_is_compiled_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    ahead.compile_ahead()
    monkeypatch.setattr(ahead, "_worker", lambda: pytest.fail("they are there"))
    ahead.compile_ahead()


def test_an_outdated_list_is_no_error_and_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mark = tmp_path / "kernels" / "listed.compiled"
    told: list[tuple[int, int]] = []
    monkeypatch.setattr(ahead, "_mark", lambda: mark)
    monkeypatch.setattr(ahead, "listed_kernels", lambda: [Kernel("graph._dense_kernels", "no_such", ["float64"])])
    monkeypatch.setattr(ahead, "_WORKER", "tests.outdated_kernels")
    ahead.compile_ahead(lambda done, known: told.append((done, known)))
    assert told == [(1, 1)]
    assert not mark.exists()


def test_what_is_not_waited_for_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mark = tmp_path / "kernels" / "listed.compiled"
    monkeypatch.setattr(ahead, "_mark", lambda: mark)
    monkeypatch.setattr(ahead, "_WORKER", "tests.silent_worker")
    before = threading.active_count()
    with pytest.raises(ValueError, match="no such log"), ahead.compiling_ahead():
        raise ValueError("no such log")
    assert threading.active_count() == before
    assert not mark.exists()
    with ahead.compiling_ahead():  # nobody holds the lock any more
        pass
