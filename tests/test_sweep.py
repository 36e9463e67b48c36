"""The sweep of a laser, learned from scans and made good: what a run does with a log that does not say it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from frontends.scan import Log
from frontends.simulator.lasers import LASERS
from frontends.simulator.simulation import Simulation, simulate
from iceg.config import Config
from iceg.evaluation.trajectory import trajectory_errors
from iceg.pipeline import run
from iceg.run_result.slam_result import SlamResult
from iceg.slam.sweep.estimate import SweepEstimate, learn_sweep
from iceg.slam.sweep.motion import motion_within
from iceg.slam.sweep_config import SweepConfig
from iceg.slam.tracking.laser_orientation import LaserOrientation

WITHOUT = replace(Config(), front_end=replace(Config().front_end, deskew=False))


@cache
def _simulated(laser: str, way: int = 1) -> Simulation:
    """A drive through rooms; `way` 0 is an instant laser, -1 one that turns the other way round."""
    usual = LASERS[laser]()
    return simulate("room", 3, laser=replace(usual, sweep_time=way * usual.sweep_time))


@cache
def _run(laser: str, way: int, *, deskew: bool = True) -> SlamResult:
    return run(_simulated(laser, way).log, Config() if deskew else WITHOUT)


def _learned(simulation: Simulation) -> SweepEstimate:
    log = simulation.log
    found = learn_sweep(log, simulation.truth, motion_within(simulation.truth, log.stamps), SweepConfig())
    assert found is not None
    return found


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("laser", ["rplidar-a1", "lds-01", "urg-04lx"])
def test_duration_and_direction_are_learned_within_their_deviation(laser: str, way: int) -> None:
    found = _learned(_simulated(laser, way))
    usual = LASERS[laser]()
    true = way * usual.sweep_time / usual.period
    assert found.is_significant(SweepConfig().false_alarm)
    assert abs(found.share - true) < 3.0 * found.deviation
    assert found.deviation < 0.1


@pytest.mark.parametrize("laser", ["sick", "rplidar-a1", "lds-01"])
def test_a_laser_that_does_not_sweep_is_not_taken_for_one(laser: str) -> None:
    assert not _learned(_simulated(laser, 0)).is_significant(SweepConfig().false_alarm)


def test_a_robot_that_never_moves_tells_nothing() -> None:
    log = _simulated("rplidar-a1").log
    still = log.select(np.zeros(60, dtype=np.int64))
    truth = np.zeros((60, 3))
    found = learn_sweep(still, truth, motion_within(truth, np.arange(60.0)), SweepConfig())
    assert found is None or not found.is_significant(SweepConfig().false_alarm)


@pytest.mark.parametrize("way", [1, -1])
def test_the_trajectory_is_nearly_as_good_as_without_a_sweep(way: int) -> None:
    swept, straightened, instant = (
        _error(_run("rplidar-a1", way, deskew=False), way),
        _error(_run("rplidar-a1", way), way),
        _error(_run("rplidar-a1", 0), 0),
    )
    assert straightened < 0.5 * swept
    assert straightened < instant + 0.005


def test_walls_in_the_grid_are_as_thin_as_without_a_sweep() -> None:
    """Occupied cells: the walls seen are the same ones."""
    swept, straightened, instant = (
        _occupied(_run("rplidar-a1", 1, deskew=False)),
        _occupied(_run("rplidar-a1", 1)),
        _occupied(_run("rplidar-a1", 0)),
    )
    assert straightened < 1.05 * instant
    assert straightened <= 1.02 * swept


def test_the_summary_says_what_was_learned() -> None:
    found = _run("rplidar-a1", 1).summary["sweep"]
    assert found["source"] == "scans"
    assert found["applied"]
    assert found["direction"] == "clockwise"
    assert found["duration_s"] == pytest.approx(0.1795, abs=3.0 * found["std_s"])


def test_a_log_of_an_instant_laser_is_left_as_it_is() -> None:
    result = _run("rplidar-a1", 0)
    assert not result.summary["sweep"]["applied"]
    assert result.log.ranges is _simulated("rplidar-a1", 0).log.ranges
    without = _run("rplidar-a1", 0, deskew=False)
    np.testing.assert_array_equal(result.trajectory, without.trajectory)


def test_what_the_log_says_of_its_sweep_is_taken() -> None:
    log = replace(_simulated("rplidar-a1").log, sweep=LASERS["rplidar-a1"]().sweep_time)
    found = run(log).summary["sweep"]
    assert (found["source"], found["applied"], found["direction"]) == ("log", True, "clockwise")
    assert found["duration_s"] == pytest.approx(0.1795, abs=1e-4)


def test_a_log_that_says_all_at_once_is_believed() -> None:
    log = replace(_simulated("rplidar-a1").log, sweep=0.0)
    found = run(log).summary["sweep"]
    assert (found["source"], found["applied"]) == ("log", False)


def test_a_laser_mounted_upside_down_turns_the_other_way() -> None:
    log: Log = replace(_simulated("rplidar-a1").log, sweep=0.2)
    assert LaserOrientation(is_mirrored=True).corrected(log).sweep == -0.2


def _error(result: SlamResult, way: int) -> float:
    return trajectory_errors(result.trajectory, _simulated("rplidar-a1", way).truth).ate_rmse


def _occupied(result: SlamResult) -> int:
    return int((result.grid.occupancy() > 0.6).sum())
