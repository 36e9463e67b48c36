"""Stamps that step back: repaired so that they increase, and evo then finds what `iceg eval` finds."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import iceg
from frontends.scan import Log
from graph.se2 import compose
from iceg.cli import main
from iceg.evaluation.trajectory import read_reference_csv
from iceg.stamps import repaired_stamps, steps_back
from iceg.tum import format_tum, read_tum

Array = NDArray[np.float64]


def written(stamps: Array) -> list[int]:
    """In microseconds, as a TUM file has them."""
    return [round(float(f"{stamp:.6f}") * 1e6) for stamp in stamps]


@given(st.lists(st.floats(-1e6, 2e9), min_size=1, max_size=60))
def test_repaired_stamps_increase_as_written(stamps: list[float]) -> None:
    assert (np.diff(written(repaired_stamps(np.array(stamps)))) > 0).all()


@given(st.lists(st.integers(1, 10**6), min_size=1, max_size=60), st.floats(0, 2e9))
def test_stamps_that_increase_stay(steps: list[int], start: float) -> None:
    stamps = round(start, 6) + np.cumsum(steps) * 1e-6
    np.testing.assert_allclose(repaired_stamps(stamps), stamps, rtol=0, atol=1e-6)


def test_as_many_recorded_stamps_as_can_be_are_kept() -> None:
    stamps = np.array([0.0, 1.0, 2.0, 1.5, 1.6, 5.0, 99.0, 6.0, 7.0, 3.0])
    np.testing.assert_allclose(repaired_stamps(stamps), [0, 1, 1.25, 1.5, 1.6, 5, 5.5, 6, 7, 7.75], atol=1e-6)
    assert steps_back(stamps) == 3
    assert steps_back(repaired_stamps(stamps)) == 0


def evo_ape(reference: Path, estimate: Path) -> float:
    """What `evo_ape tum reference estimate --align` says."""
    from evo.core import metrics, sync
    from evo.tools import file_interface

    pair = sync.associate_trajectories(
        file_interface.read_tum_trajectory_file(str(reference)), file_interface.read_tum_trajectory_file(str(estimate))
    )
    pair[1].align(pair[0])
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data(pair)
    return float(error.get_statistic(metrics.StatisticsType.rmse))


def figures(capsys: pytest.CaptureFixture[str], *words: str | Path) -> dict[str, Any]:
    assert main(["eval", *map(str, words), "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def walk(n: int) -> Array:
    rng = np.random.default_rng(0)
    poses = np.zeros((n, 3))
    for k in range(1, n):
        poses[k] = compose(poses[k - 1], rng.normal([0.3, 0, 0], [0.02, 0.01, 0.1]))
    return poses


def test_evo_and_eval_agree_on_repaired_stamps_and_not_on_recorded_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(3)
    true, stamps = walk(400), 976052857.0 + np.arange(400) / 5 + rng.normal(0, 0.2, 400)
    assert steps_back(stamps) > 50
    estimated = compose([3.0, -1.0, 2.0], true + rng.normal(0, [0.01, 0.01, 0.003], true.shape))
    for name, used in (("recorded", stamps), ("repaired", repaired_stamps(stamps))):
        (tmp_path / f"{name}.tum").write_text(format_tum(used, estimated))
        (tmp_path / f"{name}-true.tum").write_text(format_tum(used, true))
    by_scan = figures(capsys, tmp_path / "recorded.tum", "--truth", tmp_path / "recorded-true.tum")
    repaired = figures(capsys, tmp_path / "repaired.tum", "--truth", tmp_path / "repaired-true.tum", "--by", "stamp")
    assert (repaired["paired_by"], repaired["n"]) == ("stamp", 400)
    assert main(["eval", str(tmp_path / "recorded.tum"), "--truth", str(tmp_path / "recorded-true.tum")]) == 0
    assert capsys.readouterr().err == ""
    words = ["eval", str(tmp_path / "recorded.tum"), "--truth", str(tmp_path / "recorded-true.tum"), "--by", "stamp"]
    assert main(words) == 0
    assert f"{steps_back(stamps)} of the trajectory's 400 stamps are not later" in capsys.readouterr().err
    assert repaired["ate_rmse"] == by_scan["ate_rmse"]
    assert round(evo_ape(tmp_path / "repaired-true.tum", tmp_path / "repaired.tum"), 5) == repaired["ate_rmse"]


def test_evo_and_eval_agree_on_a_public_log_whose_stamps_step_back(
    data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = iceg.read_log(data_dir / "intel.clf.gz")
    reference = data_dir / "intel.reference.csv"
    scans, known = read_reference_csv(reference)
    evo = {}
    for name, used in (("recorded", log.stamps), ("repaired", repaired_stamps(log.stamps))):
        estimate, true = tmp_path / f"{name}.tum", tmp_path / f"{name}-true.tum"
        estimate.write_text(format_tum(used, log.odometry))
        true.write_text(format_tum(used[scans], known))
        evo[name] = round(evo_ape(true, estimate), 5)
    found = figures(capsys, tmp_path / "repaired.tum", "--truth", tmp_path / "repaired-true.tum")
    by_scan = figures(capsys, tmp_path / "recorded.tum", "--truth", reference)
    assert steps_back(log.stamps) > 1000
    assert (found["paired_by"], found["n"]) == ("stamp", len(scans))
    assert evo["repaired"] == found["ate_rmse"] == by_scan["ate_rmse"]
    assert evo["recorded"] != evo["repaired"]


@pytest.fixture(scope="module")
def jittering() -> Log:
    """The first metres of the embedded log, with stamps that step back."""
    whole = iceg.read_log(iceg.demo_log_path())
    stamps = whole.stamps[:60] + np.random.default_rng(0).normal(0, 0.3, 60)
    return Log(
        ranges=whole.ranges[:60],
        odometry=whole.odometry[:60],
        stamps=stamps,
        geometry=whole.geometry,
        path=whole.path,
    )


@pytest.mark.parametrize("asked", ["recorded", "repaired"])
def test_a_run_says_that_its_stamps_step_back_unless_they_are_repaired(
    jittering: Log, tmp_path: Path, asked: Any
) -> None:
    result = iceg.run(jittering, iceg.Config(stamps=asked))
    iceg.write_results(result, tmp_path / "out")
    trajectory = read_tum(tmp_path / "out" / "trajectory.tum")
    np.testing.assert_allclose(trajectory.poses, result.trajectory, atol=1e-8)
    warnings = " ".join(json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"])
    if asked == "recorded":
        np.testing.assert_allclose(trajectory.stamps, jittering.stamps, atol=1e-6)
        assert f"{steps_back(jittering.stamps)} of 60 are not later than the one before" in warnings
        assert "--stamps repaired" in warnings
    else:
        assert (np.diff(trajectory.stamps) > 0).all()
        assert "--stamps repaired" not in warnings
