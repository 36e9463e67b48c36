"""Each fault does to a log what its name says, and nothing else."""

from pathlib import Path

import numpy as np
import pytest

from frontends.logs import read_log
from frontends.scan import Log
from graph.se2 import between
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.degradation import DEGRADATIONS
from iceg.evaluation.robustness import write_faults


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(demo_log_path()).select(slice(400))


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
    np.testing.assert_array_equal(DEGRADATIONS["laser upside down"](log).log.ranges[:, 0], log.ranges[:, -1])
    ahead, back = (between(d.odometry[:-1], d.odometry[1:]) for d in (log, DEGRADATIONS["laser backwards"](log).log))
    np.testing.assert_allclose(back, ahead * (-1.0, -1.0, 1.0), atol=1e-9)
    assert not DEGRADATIONS["no odometry"](log).log.has_odometry
    crowded = DEGRADATIONS["crowd of 4"](log).log.ranges
    assert np.nanmax(crowded - log.ranges) <= 0.0
    assert 0.02 < np.mean(crowded < log.ranges) < 0.5


def test_each_fault_gives_a_row_that_tells_ruined_from_sane(tmp_path: Path) -> None:
    office = BenchLog(name="office", path=demo_log_path(), known=demo_truth_path())
    rows = list(write_faults([office], tmp_path, ["every 20th scan", "odometry dies"]))
    assert [row["fault"] for row in rows] == ["none", "every 20th scan", "odometry dies"]
    assert [row["verdict"] for row in rows[:2]] == ["sane", "sane"]
    assert str(rows[2]["verdict"]).startswith("ruined") == (float(rows[2]["ATE [m]"] or 0.0) > 0.3)
    assert len((tmp_path / "robustness.csv").read_text(encoding="utf-8").splitlines()) == 4
