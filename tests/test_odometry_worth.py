"""Whether odometry tells more of the way than the velocity does, and what becomes of one that does not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frontends.logs import read_log
from frontends.scan import Log
from frontends.simulator.simulation import Simulation, simulate
from graph.odometry import OdometryModel
from iceg.config import Config
from iceg.evaluation.degradation import laser_stuck, odometry_noisy
from iceg.ice.matcher import IceMatcher
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.velocity import foretold, steps_along
from iceg.slam.odometry.worth import error_beside_velocity, without_odometry
from iceg.slam.passes import Tracker
from iceg.slam.recording.repeated_scans import without_frozen_scans
from iceg.slam.track import Track

_TRACKER = Tracker(matcher=IceMatcher(), config=Config())


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return simulate("office", seed=2)


def _error(log: Log) -> float:
    """Of its odometry beside its velocity."""
    _, track, calibration = _TRACKER.follow(log)
    return error_beside_velocity(track, log.stamps, calibration.noise, CalibrationConfig())


def test_wheels_know_the_way_better_than_the_velocity_and_worse_where_they_spin(simulation: Simulation) -> None:
    noisy = odometry_noisy(simulation.log, move=0.9, turn=0.5).log
    assert _error(simulation.log) < 0.5
    assert _error(noisy) > CalibrationConfig().worse_than_velocity


def _steady(track: Track) -> Track:
    """The track of a robot that never changes its velocity, as far as numbers go."""
    poses = np.outer(np.arange(len(track.key_of_scan)), [0.05, 0.0, 0.0])
    keys = [replace(key, T_track_robot=poses[key.index]) for key in track.keys]
    return replace(track, keys=keys, T_key_scan=poses - poses[track.key_scans][track.key_of_scan])


def test_errors_are_those_that_both_claim(simulation: Simulation) -> None:
    """The floor alone, for a noise that does not grow: the geometric mean of one number over many."""
    _, track, _ = _TRACKER.follow(simulation.log)
    stamps, config, floor = simulation.log.stamps, CalibrationConfig(), 0.3
    constant = OdometryModel(along_floor=floor, along_per_metre=0.0, position_per_radian=0.0)
    _, by_velocity = foretold(steps_along(track, stamps), config)
    expected = floor / np.exp(np.log(by_velocity).mean() / 2.0)
    assert error_beside_velocity(track, stamps, constant, config) == pytest.approx(expected)
    assert error_beside_velocity(track, stamps, constant, replace(config, velocity_min_steps=10**6)) == 0.0
    assert error_beside_velocity(track, stamps, OdometryModel(), config) == 0.0, "assumed, not learned"
    steady = replace(config, velocity_min_sigma=1e-6)
    assert error_beside_velocity(_steady(track), stamps, config.least_noise, steady) == pytest.approx(1.0)


def test_a_log_whose_wheels_spin_is_tracked_as_one_without_odometry(simulation: Simulation) -> None:
    noisy = odometry_noisy(simulation.log, move=0.9, turn=0.5).log
    (log, track, _), _ = _TRACKER.guided(noisy)
    (alone, without, _), _ = _TRACKER.guided(without_odometry(noisy))
    assert not log.has_odometry
    assert "left out" in log.warnings[-1]
    assert log.warnings == alone.warnings
    np.testing.assert_array_equal(track.T_track_scans, without.T_track_scans)


def test_what_odometry_says_is_asked_where_it_is_not_calibrated(simulation: Simulation) -> None:
    """Nothing is learned of its noise then: nobody can say that it is worse."""
    config = replace(Config(), front_end=replace(Config().front_end, calibrate_odometry=False))
    (log, _, _), _ = replace(_TRACKER, config=config).guided(odometry_noisy(simulation.log, move=0.9, turn=0.5).log)
    assert log.has_odometry


def test_good_wheels_stay(simulation: Simulation) -> None:
    (log, _, _), _ = _TRACKER.guided(simulation.log)
    assert log is simulation.log


def test_odometry_stays_where_matches_do_not_get_along_without_it(data_dir: Path) -> None:
    """Of this laser every other scan is a repetition: MIT-CSAIL was 5.5 m off without its odometry."""
    log = without_frozen_scans(laser_stuck(read_log(data_dir / "mit-csail.clf.gz"), 2).log)
    assert _error(log) > CalibrationConfig().worse_than_velocity
    (tracked, _, _), _ = _TRACKER.guided(log)
    assert tracked.has_odometry
