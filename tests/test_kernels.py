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
from iceg.kernels.groups import ORDER, groups_of
from iceg.kernels.signatures import STAGES, Kernel, listed_kernels, plain_type, type_of
from iceg.slam.progress import Progress, Stage

pytestmark = pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")

CALLED = """
import json, sys
from iceg.demo import demo_log_path
from iceg.kernels.record import called_by
json.dump(called_by(demo_log_path()), sys.stdout)
"""


@pytest.fixture
def mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Of a first run: no kernel is compiled yet."""
    mark = tmp_path / "kernels" / "listed.compiled"
    monkeypatch.setattr(ahead, "_mark", lambda: mark)
    return mark


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


def test_what_is_kept_is_loaded_without_what_compiling_needs() -> None:
    ahead.compile_ahead()
    code = (
        "import sys\n"
        "from iceg.kernels.signatures import listed_kernels\n"
        "for kernel in listed_kernels():\n"
        "    kernel.compile()\n"
        "sys.exit(', '.join(m for m in ('numba.np.arraymath', 'scipy.linalg', 'numpy.f2py') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_a_run_calls_what_is_listed_and_compiles_nothing() -> None:
    """Once all are compiled; `python -m iceg.kernels.record` renews the list."""
    ahead.compile_ahead()
    done = subprocess.run([sys.executable, "-c", CALLED], capture_output=True, text=True, check=True)
    called, compiled = json.loads(done.stdout)
    listed = {json.dumps(kernel[1:]): STAGES.index(kernel.stage) for kernel in listed_kernels()}
    assert [kernel for kernel in called if kernel not in listed] == []
    late = [kernel for kernel, stage in called.items() if STAGES.index(stage) < listed[kernel]]
    assert late == [], "the run compiles itself what it does not wait for"
    assert not compiled


def test_each_kernel_is_in_one_group_and_what_runs_call_first_comes_first() -> None:
    kernels = listed_kernels()
    groups = groups_of(kernels)
    assert sorted(place for group in groups for place in group) == list(range(len(kernels)))
    begun = [ORDER.index(kernels[group[0]].stage) for group in groups]
    assert begun == sorted(begun)
    assert kernels[groups[-1][0]].stage == "reading"


def test_nothing_is_compiled_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    ahead.compile_ahead()
    monkeypatch.setattr(ahead, "_worker", lambda: pytest.fail("they are there"))
    ahead.compile_ahead()


def test_an_outdated_list_is_no_error_and_is_tried_again(mark: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[int, int]] = []
    monkeypatch.setattr(
        ahead, "listed_kernels", lambda: [Kernel("matching", "graph._dense_kernels", "no_such", ["float64"])]
    )
    monkeypatch.setattr(ahead, "_WORKER", "tests.outdated_kernels")
    ahead.compile_ahead(lambda done, known: told.append((done, known)))
    assert told == [(0, 1), (1, 1)]
    assert not mark.exists()


def test_what_is_not_waited_for_is_left(mark: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "_WORKER", "tests.silent_worker")
    with pytest.raises(ValueError, match="no such log"), ahead.compiling_ahead():
        raise ValueError("no such log")
    assert not mark.exists()
    with ahead.compiling_ahead():  # nobody holds the lock any more
        pass


def test_a_stage_waits_for_its_own_kernels_and_those_before_it(mark: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "_WORKER", "tests.silent_worker")
    waited: list[tuple[int, int]] = []
    passed_on: list[Stage] = []
    needed = sum(kernel.stage in ("matching", "sweep") for kernel in listed_kernels())
    with ahead.compiling_ahead() as kernels:
        proceed = kernels.before_each_stage(
            lambda now: passed_on.append(now.stage), lambda done, of: waited.append((done, of))
        )
        assert proceed is not None
        stages: tuple[Stage, ...] = ("matching", "matching", "sweep")
        for stage in stages:
            proceed(Progress(scans=1, tried=0, accepted=0, stage=stage))
    assert passed_on == ["matching", "matching", "sweep"]
    assert waited[-1] == (needed, needed)
    assert not mark.exists(), "the rest is not compiled"


def test_processes_that_die_are_not_waited_for(mark: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "_WORKER", "tests.dying_worker")
    ahead.compile_ahead()
    assert not mark.exists()


@pytest.mark.usefixtures("mark")
def test_a_process_that_compiles_may_be_copied_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "_WORKER", "tests.silent_worker")
    before = threading.active_count()
    with ahead.compiling_ahead() as kernels:
        kernels.wait_for("matching")
        assert threading.active_count() == before
