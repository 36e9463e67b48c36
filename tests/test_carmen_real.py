"""The public logs, read whole."""

import csv
import gzip
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from frontends.logs import LogError, describe_log, read_log
from frontends.logs.readers import recognise

LOGS = {
    "intel": (13631, 180, 508.0, 0.028),
    "mit-csail": (1988, 361, 374.0, 0.033),
    "aces": (7374, 180, 325.0, 0.011),
    "mrpt-simul": (1733, 361, 200.0, 0.041),
}


@pytest.mark.parametrize("name", LOGS)
def test_figures_of_the_real_logs(data_dir: Path, name: str) -> None:
    scans, beams, path_length, no_return = LOGS[name]
    log = read_log(data_dir / f"{name}.clf.gz")
    info = describe_log(log)
    assert (info.scans, info.beams) == (scans, beams)
    assert info.path_length == pytest.approx(path_length, rel=0.01)
    assert info.no_return_share == pytest.approx(no_return, abs=0.002)
    assert info.range_quartiles[4] <= log.geometry.range_max <= 40.0
    assert log.has_odometry
    assert log.ranges.dtype == np.float32
    assert all("step back" in warning for warning in log.warnings)


def test_every_reading_is_the_one_that_stands_in_the_file(data_dir: Path) -> None:
    log = read_log(data_dir / "mit-csail.clf.gz")
    with gzip.open(data_dir / "mit-csail.clf.gz", "rt") as file:
        rows = [line.split() for line in file if line.startswith("FLASER")]
    readings = np.array([[float(word) for word in row[2:363]] for row in rows]).astype(np.float32)
    readings[readings > 40.0] = np.nan
    assert_array_equal(log.ranges, readings)
    assert_array_equal(log.stamps, [float(row[369]) for row in rows])
    assert_allclose(log.odometry[:, :2], [[float(row[366]), float(row[367])] for row in rows], atol=0)


def test_simulated_log_has_its_laser_ahead(data_dir: Path) -> None:
    log = read_log(data_dir / "mrpt-simul.clf.gz")
    assert_allclose(log.geometry.T_robot_laser, [0.2, 0.0, 0.0], atol=1e-5)
    with (data_dir / "mrpt-simul.truth.csv").open() as file:
        truth = [float(row["t_s"]) for row in csv.DictReader(file)]
    assert len(log) == len(truth)


def test_intel_stamps_stay_in_file_order(data_dir: Path) -> None:
    log = read_log(data_dir / "intel.clf.gz")
    assert describe_log(log).stamps_stepping_back > 600
    assert log.stamps[0] == 976052857.337530


def test_readings_beyond_forty_metres_on_request(data_dir: Path) -> None:
    log = read_log(data_dir / "aces.clf.gz", range_max=80.0)
    assert 40.0 < np.nanmax(log.ranges) < 49.95


def test_a_format_that_is_not_known_is_refused(data_dir: Path) -> None:
    with pytest.raises(LogError, match="expected a log of one of the formats"):
        read_log(data_dir / "posegraph" / "intel.g2o")


@pytest.mark.parametrize(
    ("name", "log_format"), [("dpslam-loop5.log.gz", "dpslam"), ("usarsim-scan-pairs.txt.gz", "usarsim")]
)
def test_other_formats_are_not_taken_for_carmen(data_dir: Path, name: str, log_format: str) -> None:
    assert recognise(data_dir / name) == log_format
