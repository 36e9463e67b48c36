"""Each fault does to a log what its name says, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from frontends.logs import read_log
from frontends.scan import Log
from graph.se2 import between
from iceg.demo import demo_log_path
from iceg.evaluation.degradation import DEGRADATIONS


@pytest.fixture(scope="module")
def log() -> Log:
    whole = read_log(demo_log_path())
    return replace(whole, ranges=whole.ranges[:400], odometry=whole.odometry[:400], stamps=whole.stamps[:400])


@pytest.mark.parametrize("name", DEGRADATIONS)
def test_a_degraded_log_is_a_log_and_the_first_one_is_untouched(log: Log, name: str) -> None:
    ranges, odometry = log.ranges.copy(), log.odometry.copy()
    degraded = DEGRADATIONS[name](log)
    np.testing.assert_array_equal(log.ranges, ranges)
    np.testing.assert_array_equal(log.odometry, odometry)
    found = degraded.log
    assert len(found) == len(found.odometry) == len(found.stamps) == len(degraded.scans) > 1
    assert found.ranges.shape[1] == found.geometry.n_beams
    assert found.ranges.dtype == np.float32
    same = (
        found.ranges.shape == ranges.shape
        and np.array_equal(found.ranges, ranges, equal_nan=True)
        and np.array_equal(found.odometry, odometry)
        and np.array_equal(found.stamps, log.stamps)
    )
    assert same == (name == "30 m")  # its laser reaches 20 m
    again = DEGRADATIONS[name](log).log
    np.testing.assert_array_equal(found.ranges, again.ranges)
    np.testing.assert_array_equal(found.odometry, again.odometry)


def test_what_some_of_them_do(log: Log) -> None:
    assert DEGRADATIONS["every 5th scan"](log).scans.tolist() == list(range(0, 400, 5))
    sparse = DEGRADATIONS["a scan every metre"](log).log
    assert np.hypot(*between(sparse.odometry[:-1], sparse.odometry[1:])[:, :2].T).min() >= 1.0
    assert np.nanmax(DEGRADATIONS["8 m"](log).log.ranges) <= 8.0
    assert DEGRADATIONS["90° view"](log).log.geometry.field_of_view == pytest.approx(np.pi / 2)
    assert not DEGRADATIONS["no odometry"](log).log.has_odometry
    crowded = DEGRADATIONS["crowd of 4"](log).log.ranges
    assert np.nanmax(crowded - log.ranges) <= 0.0
    assert 0.02 < np.mean(crowded < log.ranges) < 0.5
