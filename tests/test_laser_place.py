"""Where a laser sits whose log does not say it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from graph.se2 import compose
from iceg.config import Config
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.trajectory import read_truth_csv, trajectory_errors
from iceg.export.recorded_log import read_log_of_run
from iceg.findings_file.codec import read_findings
from iceg.mapper import Mapper
from iceg.maps.config import GridConfig
from iceg.pipeline import resolve, run
from iceg.results import write_results
from iceg.slam.config import FinishConfig, FrontEndConfig

_SCANS = 700
_QUICK = Config(grid=GridConfig(resolution=0.2), finish=FinishConfig(enabled=False))


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(demo_log_path()).select(slice(0, _SCANS))


@pytest.fixture(scope="module")
def truth() -> NDArray[np.float64]:
    return read_truth_csv(demo_truth_path())[:_SCANS]


def _silent(log: Log, T_robot_laser: NDArray[np.float64] | None = None, *, is_mount_known: bool = False) -> Log:
    """The log without a word on where its laser sits."""
    taken = np.zeros(3) if T_robot_laser is None else T_robot_laser
    return replace(log, geometry=replace(log.geometry, T_robot_laser=taken), is_mount_known=is_mount_known)


def test_the_odometry_tells_where_the_laser_sits(log: Log, truth: NDArray[np.float64]) -> None:
    result = run(_silent(log), _QUICK)
    np.testing.assert_allclose(result.log.geometry.T_robot_laser, log.geometry.T_robot_laser, atol=0.01)
    assert trajectory_errors(result.trajectory, truth).ate_rmse < 0.02
    assert "ahead of the robot's centre" in result.summary["chosen"]["mount"]
    assert sum("where the laser sits" in warning for warning in result.log.warnings) == 1
    x, y, heading = result.log.geometry.T_robot_laser.tolist()
    assert result.summary["mount"] == {"x_m": x, "y_m": y, "heading_rad": heading}
    taken_for_centre = run(_silent(log, is_mount_known=True), _QUICK)
    assert trajectory_errors(taken_for_centre.trajectory, truth).ate_rmse > 0.1
    assert "mount" not in taken_for_centre.summary


def test_wherever_it_sits_against_where_it_is_taken_to(log: Log, truth: NDArray[np.float64]) -> None:
    """A robot whose centre is elsewhere, as its odometry and the truth have it, and a log that supposes a place."""
    centre = np.array([0.1, -0.2, 0.0])
    T_robot_laser = compose(-centre, log.geometry.T_robot_laser)
    elsewhere = replace(log, odometry=compose(log.odometry, centre))
    result = run(_silent(elsewhere, np.array([0.4, 0.0, 0.0])), _QUICK)
    np.testing.assert_allclose(result.log.geometry.T_robot_laser, T_robot_laser, atol=0.015)
    assert trajectory_errors(result.trajectory, compose(truth, centre)).ate_rmse < 0.03


@pytest.mark.parametrize("why", ["as it is taken", "no odometry", "it stands", "not asked"])
def test_it_stays_where_it_is_taken_to_sit_unless_odometry_tells(log: Log, why: str) -> None:
    config = _QUICK
    if why == "as it is taken":
        silent = _silent(log, log.geometry.T_robot_laser + np.array([0.01, 0.0, 0.0]))
    elif why == "no odometry":
        silent = replace(_silent(log), has_odometry=False, odometry=np.zeros_like(log.odometry)).select(slice(0, 200))
    elif why == "it stands":
        silent = _silent(log).select(slice(0, 10))
    else:
        silent = _silent(log).select(slice(0, 200))
        config = replace(_QUICK, front_end=FrontEndConfig(calibrate_odometry=False))
    result = run(silent, config)
    np.testing.assert_array_equal(result.log.geometry.T_robot_laser, silent.geometry.T_robot_laser)


def test_what_is_made_of_a_run_has_the_laser_in_its_place(log: Log, tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    lines = ["## Player version 1.6.5"]
    for k, (x, y, heading) in enumerate(log.odometry.tolist()):
        time = f"{1.0 + log.stamps[k]:014.3f}"
        pairs = " ".join(f"{reading:.3f} 0" for reading in np.nan_to_num(log.ranges[k], nan=81.91).tolist())
        lines.append(f"{time} robot 6665 position 00 {time} {x:.4f} {y:.4f} {heading:.5f} 0 0 0 0")
        lines.append(f"{time} robot 6665 laser 00 {time} -1.5708 +1.5708 +.01745329 0181 {pairs}")
    path.write_text("\n".join([*lines, ""]))
    recorded = read_log(path)
    assert not recorded.is_mount_known
    result = run(recorded, _QUICK)
    write_results(result, tmp_path / "run")
    assert result.log.geometry.T_robot_laser[0] == pytest.approx(0.16, abs=0.01)
    again = read_log_of_run(tmp_path / "run", path)
    np.testing.assert_array_equal(again.geometry.T_robot_laser, result.log.geometry.T_robot_laser)
    findings = read_findings(tmp_path / "run" / "run.npz")
    assert findings.calibration == result.findings.calibration
    resolved = resolve(findings)
    np.testing.assert_array_equal(resolved.trajectory, result.trajectory)
    assert resolved.summary["mount"] == result.summary["mount"]


def test_a_mapper_may_not_know_the_place_either(log: Log) -> None:
    silent = _silent(log).select(slice(0, 300))
    mapper = Mapper(silent.geometry, _QUICK, is_mount_known=False)
    for ranges, odometry, stamp in zip(silent.ranges, silent.odometry, silent.stamps.tolist(), strict=True):
        mapper.add(ranges, odometry, stamp)
    finished, expected = mapper.finish(), run(silent, _QUICK)
    assert expected.log.geometry.T_robot_laser[0] == pytest.approx(0.16, abs=0.02)
    np.testing.assert_array_equal(finished.trajectory, expected.trajectory)


def test_a_log_that_is_wrong_about_it_is_told_so(log: Log) -> None:
    beside = replace(log, geometry=replace(log.geometry, T_robot_laser=np.array([-0.1, 0.2, 0.0])))
    (warning,) = (said for said in run(beside, _QUICK).run_warnings if said.kind == "laser place")
    assert "sits 0.10 m behind the robot's centre and 0.20 m to its left, the log says" in warning.sentence
    assert "odometry says 0.16 m ahead of" in warning.sentence
    assert all(said.kind != "laser place" for said in run(log, _QUICK).run_warnings)
