"""Logs that go wrong: the run ends with a sane map, or says where it broke."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from graph.se2 import between, compose
from iceg.config import Config
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.trajectory import read_truth_csv, trajectory_errors
from iceg.maps.config import GridConfig
from iceg.slam.pipeline import SlamResult, run

_QUICK = Config(grid=GridConfig(resolution=0.2))


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(demo_log_path())


@pytest.fixture(scope="module")
def truth() -> NDArray[np.float64]:
    return read_truth_csv(demo_truth_path())


def _rmse(result: SlamResult, truth: NDArray[np.float64]) -> float:
    return trajectory_errors(result.trajectory, truth).ate_rmse


def _with_jumps(log: Log, at: list[int], angle: float) -> Log:
    steps = between(log.odometry[:-1], log.odometry[1:])
    steps[at, 2] += angle
    odometry = [log.odometry[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    return replace(log, odometry=np.array(odometry))


def test_heading_jumps_of_the_odometry(log: Log, truth: NDArray[np.float64]) -> None:
    result = run(_with_jumps(log, [300, 700, 1200], np.radians(30.0)), _QUICK)
    assert _rmse(result, truth) < 0.1
    assert result.summary["odometry_jumps"] >= 2


@pytest.mark.parametrize("reading", [0.1, np.nan])
def test_a_laser_covered_for_ten_seconds(log: Log, truth: NDArray[np.float64], reading: float) -> None:
    ranges = log.ranges.copy()
    ranges[600:650] = reading
    result = run(replace(log, ranges=ranges), _QUICK)
    assert result.summary["scans_carried_by_odometry"] >= 50
    assert _rmse(result, truth) < 0.2


def test_half_of_the_beams_missing(log: Log, truth: NDArray[np.float64]) -> None:
    ranges = log.ranges.copy()
    ranges[np.random.default_rng(0).random(ranges.shape) < 0.5] = np.nan
    assert _rmse(run(replace(log, ranges=ranges), _QUICK), truth) < 0.1


def test_no_odometry_at_all(log: Log, truth: NDArray[np.float64]) -> None:
    result = run(replace(log, odometry=np.zeros_like(log.odometry), has_odometry=False), _QUICK)
    assert _rmse(result, truth) < 0.1
    assert result.summary["factors"]["odometry"] < 10


def test_one_scan_gives_a_map_around_the_origin(log: Log) -> None:
    one = replace(log, ranges=log.ranges[:1], odometry=log.odometry[:1], stamps=log.stamps[:1])
    result = run(one)
    np.testing.assert_array_equal(result.trajectory, np.zeros((1, 3)))
    assert len(result.graph) == 1
    assert (result.grid.classes() == 100).any()


def test_a_log_that_never_sees_anything_still_ends(log: Log) -> None:
    blind = replace(log, ranges=np.full((40, log.ranges.shape[1]), np.nan, np.float32))
    result = run(replace(blind, odometry=log.odometry[:40], stamps=log.stamps[:40]), _QUICK)
    assert result.summary["scans_carried_by_odometry"] == 39
    assert np.isfinite(result.trajectory).all()
