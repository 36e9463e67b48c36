"""Logs that go wrong: the run ends with a sane map, or says where it broke."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from iceg.config import Config
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.degradation import DEGRADATIONS
from iceg.evaluation.trajectory import read_truth_csv, trajectory_errors
from iceg.maps.config import GridConfig
from iceg.pipeline import run
from iceg.run_result.slam_result import SlamResult

_QUICK = Config(grid=GridConfig(resolution=0.2))


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(demo_log_path()).select(slice(1000))


@pytest.fixture(scope="module")
def truth() -> NDArray[np.float64]:
    return read_truth_csv(demo_truth_path())[:1000]


def _rmse(result: SlamResult, truth: NDArray[np.float64]) -> float:
    return trajectory_errors(result.trajectory, truth).ate_rmse


@pytest.mark.parametrize(
    ("fault", "bound"),
    [
        ("every 10th scan", 0.1),
        ("a scan every metre", 0.1),
        ("8 m", 0.1),
        ("half the readings", 0.1),
        ("crowd of 4", 0.3),
        ("covered", 0.1),
        ("blind", 0.1),
        ("gap", 0.1),
        ("drift 5°/m", 0.1),
        ("jumps 30°", 0.1),
        ("jumps 10 m", 0.1),
        ("reset", 0.1),
        ("odometry dies", 0.1),
        ("odometry stuck 5", 0.1),
        ("frozen", 0.1),
        ("twice", 0.1),
    ],
)
def test_faults_of_robot_laser_and_recorder(log: Log, truth: NDArray[np.float64], fault: str, bound: float) -> None:
    degraded = DEGRADATIONS[fault](log)
    result = run(degraded.log, _QUICK)
    assert _rmse(result, truth[degraded.scans]) < bound
    if fault in {"covered", "blind"}:
        assert result.summary["scans_carried_by_odometry"] >= 40
    if fault in {"jumps 10 m", "reset"}:
        assert len(result.summary["odometry_breaks_at_scans"]) == (1 if fault == "reset" else 3)
    if fault in {"odometry dies", "odometry stuck 5", "frozen"}:
        assert "odometry" in result.summary["warnings"][-1]
    if fault == "jumps 30°":
        assert result.summary["odometry_jumps"] >= 2


def test_no_odometry_at_all(log: Log, truth: NDArray[np.float64]) -> None:
    result = run(replace(log, odometry=np.zeros_like(log.odometry), has_odometry=False), _QUICK)
    assert _rmse(result, truth) < 0.1


def test_one_scan_gives_a_map_around_the_origin(log: Log) -> None:
    one = replace(log, ranges=log.ranges[:1], odometry=log.odometry[:1], stamps=log.stamps[:1])
    result = run(one)
    np.testing.assert_array_equal(result.trajectory, np.zeros((1, 3)))
    assert len(result.graph) == 1
    assert (result.grid.classes() == 100).any()


def test_a_log_that_never_sees_anything_still_ends(log: Log) -> None:
    first = log.select(slice(40))
    result = run(replace(first, ranges=np.full_like(first.ranges, np.nan)), _QUICK)
    assert result.summary["scans_carried_by_odometry"] == 39
    assert np.isfinite(result.trajectory).all()
