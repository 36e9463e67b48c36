"""What a run says while it runs."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from numba import config as numba_config
from numba import njit

from frontends.scan import Log, ScanGeometry
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


def test_the_bar_tells_scans_speed_and_share_of_matches(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar(make_log(4)) as bar:
        for scans in range(1, 5):
            bar(Progress(scans=scans, tried=scans, accepted=scans - 1))
    assert bar.matching == Progress(scans=4, tried=4, accepted=3)
    last = capsys.readouterr().err.split("\r")[-1]
    assert "made-up.clf, matching: 100%" in last
    assert "4/4 scans" in last
    assert "x real time, 75 % matched" in last


def test_what_is_left_is_not_told_from_the_first_scans(capsys: pytest.CaptureFixture[str]) -> None:
    for done, tells in ((1, False), (4, True)):
        with ProgressBar(make_log(20)) as bar:
            bar(Progress(scans=done, tried=done, accepted=done))
        last = capsys.readouterr().err.split("\r")[-1]
        assert f"{done}/20 scans" in last
        assert (" left" in last) == tells


def test_each_stage_has_a_bar_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar(make_log(4)) as bar:
        for stage in get_args(Stage):
            for scans in range(1, 5):
                bar(Progress(scans=scans, tried=scans, accepted=scans, stage=stage))
    assert bar.matching == Progress(scans=4, tried=4, accepted=4)
    ends = [line.split("\r")[-1] for line in capsys.readouterr().err.strip().split("\n")]
    assert [end.split(":")[0] for end in ends] == [f"made-up.clf, {stage}" for stage in get_args(Stage)]
    assert all(": 100%" in end for end in ends)


def test_a_run_cut_short_leaves_the_bar_where_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    bar = ProgressBar(make_log(4))
    with bar:
        bar(Progress(scans=1, tried=0, accepted=0))
    assert "1/4 scans" in capsys.readouterr().err


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
