"""What a run says while it runs."""

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import get_args

import numpy as np
import pytest
from numba import config as numba_config
from numba import njit

from frontends.logs import read_log
from frontends.scan import Log, ScanGeometry
from iceg import pipeline
from iceg.demo import demo_log_path
from iceg.show import progress
from iceg.show.progress import ProgressBar, compile_note, real_time_factor
from iceg.slam.progress import Progress, Stage


def make_log(n: int) -> Log:
    return Log(
        ranges=np.ones((n, 3), np.float32),
        odometry=np.zeros((n, 3)),
        stamps=np.arange(n, dtype=np.float64) * 1000.0,
        geometry=ScanGeometry(bearings=np.linspace(-1, 1, 3), range_min=0.1, range_max=10.0),
        path=Path("made-up.clf"),
    )


def shown(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capsys.readouterr().err.replace("\n", "\r").split("\r") if line.strip()]


def share(line: str) -> int:
    return int(line.partition("%")[0].split()[-1])


@pytest.fixture
def terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> pytest.CaptureFixture[str]:
    """What is written to stderr, which is a terminal."""
    monkeypatch.setattr(progress, "_is_in_file", lambda: False)
    return capsys


def test_the_bar_tells_stage_scans_speed_and_share_of_matches(terminal: pytest.CaptureFixture[str]) -> None:
    with ProgressBar(make_log(4)) as bar:
        for scans in range(1, 5):
            bar(Progress(scans=scans, tried=scans, accepted=scans - 1))
            bar._bar.refresh()
    assert bar.matching == Progress(scans=4, tried=4, accepted=3)
    lines = shown(terminal)
    matched, done = [line for line in lines if "made-up.clf, matching" in line][-1], lines[-1]
    assert "4/4 scans" in matched
    assert "x real time, 75 % matched" in matched
    assert share(matched) < 50
    assert "made-up.clf, done: 100%" in done


def test_waiting_for_kernels_is_told_and_is_no_progress(terminal: pytest.CaptureFixture[str]) -> None:
    with ProgressBar(make_log(4)) as bar:
        bar(Progress(scans=4, tried=4, accepted=4))
        bar.compiling(41, 55)
        bar.compiling(42, 55)
        bar(Progress(scans=4, tried=4, accepted=4, stage="graph"))
    lines = shown(terminal)
    waited = [line for line in lines if "compiling" in line]
    assert "made-up.clf, compiling 42 of 55" in waited[-1]
    assert share(waited[0]) == share(waited[-1]) < share(lines[-1])


def test_every_stage_is_named_and_the_bar_is_full_only_at_the_end(terminal: pytest.CaptureFixture[str]) -> None:
    stages = [stage for stage in get_args(Stage) if stage != "filtering"]
    with ProgressBar(make_log(4)) as bar:
        for stage in stages:
            bar(Progress(scans=4, tried=4, accepted=4, stage=stage))
        for k, part in enumerate(("map", "report")):
            bar.writing(part, k, 2)
        before = shown(terminal)
    for words in ("matching", "sweep", "graph", "finish", "covariances", "feature map", "grid", "writing report"):
        assert any(f"made-up.clf, {words}" in line for line in before)
    shares = [share(line) for line in before]
    assert shares == sorted(shares)
    assert shares[-1] < 100
    assert share(shown(terminal)[-1]) == 100


def test_a_second_pass_over_the_log_does_not_turn_the_bar_back(terminal: pytest.CaptureFixture[str]) -> None:
    with ProgressBar(make_log(10)) as bar:
        for scans in (9, 1, 10):
            bar(Progress(scans=scans, tried=1, accepted=1))
            bar._bar.refresh()
    shares = [share(line) for line in shown(terminal)]
    assert shares == sorted(shares)


def test_a_run_cut_short_leaves_the_bar_where_it_was(terminal: pytest.CaptureFixture[str]) -> None:
    bar = ProgressBar(make_log(4))
    bar(Progress(scans=2, tried=1, accepted=1, stage="graph"))
    bar.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert share(shown(terminal)[-1]) < 100


def test_in_a_file_a_stage_is_a_line_and_nothing_is_drawn_over(capsys: pytest.CaptureFixture[str]) -> None:
    stages: list[Stage] = ["matching", "graph", "finish"]
    with ProgressBar(make_log(400)) as bar:
        for stage in stages:
            for scans in range(0, 401, 4):
                bar(Progress(scans=scans, tried=scans, accepted=scans, stage=stage))
        for k in range(50):
            bar.compiling(k, 50)
        for k, part in enumerate(("map", "report", "summary")):
            bar.writing(part, k, 3)
    told = capsys.readouterr().err
    assert "\r" not in told
    lines = told.splitlines()
    words = [line.removeprefix("made-up.clf, ").partition(":")[0].split()[0] for line in lines]
    assert words == ["starting", *stages, "compiling", "writing", "done"]
    assert lines[-1].startswith("made-up.clf, done: 100%, 00:0")


def test_who_starts_kernels_elsewhere_is_in_no_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    assert not progress._is_in_notebook()
    shell = SimpleNamespace(config={"IPKernelApp": {}})
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    assert progress._is_in_notebook()


def test_a_run_tells_its_stages_in_their_order() -> None:
    told: list[Progress] = []
    whole = read_log(demo_log_path())
    short = replace(whole, ranges=whole.ranges[:60], odometry=whole.odometry[:60], stamps=whole.stamps[:60], truth=None)
    pipeline.run(short, None, told.append)
    assert list(dict.fromkeys(each.stage for each in told)) == [*get_args(Stage)][:-1]
    assert all(each.scans == 60 for each in told if each.stage not in {"matching", "sweep"})


def test_real_time_factor() -> None:
    assert real_time_factor(np.array([10.0, 15.0, 20.0]), 2.0) == 5.0
    assert real_time_factor(np.array([10.0]), 2.0) is None
    assert real_time_factor(np.array([10.0, 10.0]), 2.0) is None
    assert real_time_factor(np.array([10.0, 9.0]), 2.0) is None


@pytest.mark.skipif(bool(getattr(numba_config, "DISABLE_JIT", 0)), reason="nothing is compiled")
def test_compiling_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    @njit(cache=False)
    def doubled(value: float) -> float:
        return 2.0 * value

    with compile_note():
        assert doubled(1.0) == 2.0
        assert doubled(1) == 2
    assert capsys.readouterr().err.count("compiling kernels") == 1
    with compile_note():
        assert doubled(3.0) == 6.0
    assert capsys.readouterr().err == ""
