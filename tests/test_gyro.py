"""The turn rate of a gyro as odometry of the heading."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.bags.gyro import turned_at
from frontends.logs import read_log
from frontends.logs.info import describe_log
from frontends.logs.writers import write_log
from frontends.scan import Log, ScanError
from frontends.simulator.gyro import GyroModel
from frontends.simulator.simulation import simulate
from iceg.config import Config
from iceg.evaluation.trajectory import trajectory_errors
from iceg.pipeline import run
from iceg.run_result.slam_result import SlamResult
from iceg.slam.config import FinishConfig, FrontEndConfig
from tests import bags

WITHOUT = Config(front_end=FrontEndConfig(gyro=False))
DEGREES_UPSIDE_DOWN = GyroModel(scale=-math.degrees(1.0))


def thinned(scene: str, step: int, gyro: GyroModel = DEGREES_UPSIDE_DOWN) -> tuple[Log, NDArray[np.float64]]:
    """Every `step`-th scan of a drive without odometry, and the truth."""
    drive = simulate(scene, seed=1, gyro=gyro)
    log = drive.log.select(slice(0, None, step))
    return replace(log, odometry=np.zeros_like(log.odometry), has_odometry=False), drive.truth[::step]


@pytest.fixture(scope="module")
def turning() -> tuple[Log, NDArray[np.float64]]:
    """Two seconds from scan to scan, and turns of up to 90° in between."""
    return thinned("rooms", 10)


@pytest.fixture(scope="module")
def by_gyro(turning: tuple[Log, NDArray[np.float64]]) -> SlamResult:
    return run(turning[0])


def test_a_gyro_keeps_a_robot_that_matching_alone_loses(
    turning: tuple[Log, NDArray[np.float64]], by_gyro: SlamResult
) -> None:
    log, truth = turning
    alone = run(log, WITHOUT)
    assert alone.summary["lost_at_scans"]
    assert alone.summary["breaks"], "only its maps say where it went on"
    assert not by_gyro.summary["warnings"]
    assert trajectory_errors(by_gyro.trajectory, truth).ate_rmse < 0.02


def test_unit_sign_and_bias_are_learned(by_gyro: SlamResult) -> None:
    found = by_gyro.summary["gyro"]
    assert found["used"]
    np.testing.assert_allclose(found["rad_per_unit"], [0.0, 0.0, -math.radians(1.0)], rtol=0.005)
    assert found["bias_rad_per_s"] == pytest.approx(-math.radians(0.5), abs=0.001)
    assert abs(found["delay_s"]) < 0.1


def test_a_gyro_about_a_slanted_axis_is_read_about_all_axes_that_tell() -> None:
    log, truth = thinned("room", 4)
    assert log.gyro is not None
    shaken = np.cumsum(np.random.default_rng(0).normal(0.0, 2.0, len(log)))
    slanted = np.column_stack([log.gyro[:, 2] + shaken, np.zeros(len(log)), log.gyro[:, 2] - shaken])
    result = run(replace(log, gyro=slanted))
    found = result.summary["gyro"]
    np.testing.assert_allclose(found["rad_per_unit"], np.array([0.5, 0.0, 0.5]) * -math.radians(1.0), rtol=0.02)
    assert found["turn_std_rad"] < 0.01
    assert trajectory_errors(result.trajectory, truth).ate_rmse < 0.02


def test_turn_rates_of_another_robot_change_nothing_and_that_is_said() -> None:
    log, _ = thinned("room", 2)
    other, _ = thinned("rooms", 2)
    assert other.gyro is not None
    result = run(replace(log, gyro=other.gyro[: len(log)]))
    assert not result.summary["gyro"]["used"]
    (told,) = (warning for warning in result.summary["warnings"] if "gyro" in warning)
    assert "not used" in told
    np.testing.assert_array_equal(result.trajectory, run(log, WITHOUT).trajectory)


def test_beside_odometry_a_gyro_is_not_asked() -> None:
    drive = simulate("room", seed=1, gyro=DEGREES_UPSIDE_DOWN)
    log = drive.log.select(slice(0, 60))
    with_gyro, without = run(log), run(replace(log, gyro=None))
    assert "gyro" not in with_gyro.summary
    np.testing.assert_array_equal(with_gyro.trajectory, without.trajectory)


def test_a_gyro_that_reports_nothing_is_told() -> None:
    log, _ = thinned("room", 2)
    result = run(replace(log, gyro=np.zeros((len(log), 3))))
    assert result.summary["gyro"] == {"used": False, "reason": "they are all zero"}


def test_a_real_gyro_turns_out_to_report_degrees_clockwise(data_dir: Path) -> None:
    log = read_log(data_dir / "bags" / "mumble-kitchen_1")
    found = run(log, Config(finish=FinishConfig(enabled=False))).summary["gyro"]
    assert found["used"]
    np.testing.assert_allclose(found["rad_per_unit"], [0.0, 0.0, -math.radians(1.0)], rtol=0.05)
    assert found["turn_std_rad"] < 0.5 * found["turn_std_of_constant_velocity_rad"]


def test_a_rate_that_grows_evenly_turns_by_its_square() -> None:
    times = np.arange(0.0, 2.01, 0.1)
    at = np.array([0.05, 0.5, 1.23, 1.99])
    turned = turned_at(times, np.column_stack([times, np.ones_like(times)]), at)
    expected = np.column_stack([0.5 * at**2, at])
    np.testing.assert_allclose(turned, expected - expected[:1], atol=1e-12)


def test_before_the_first_rate_and_behind_the_last_they_go_on() -> None:
    turned = turned_at(np.array([1.0, 2.0]), np.array([[1.0], [3.0]]), np.array([0.5, 1.0, 2.0, 2.5]))
    np.testing.assert_allclose(turned[:, 0], [0.0, 0.5, 2.5, 4.0])


def said(n: int, *, last_imu: float, with_odometry: bool = False) -> list[bags.Said]:
    """Scans at 10 Hz and an IMU at 50 Hz, which turns at 2 about z."""
    rng = np.random.default_rng(0)
    scans = [bags.scan(100.0 + 0.1 * k, rng.uniform(1.0, 5.0, 20).tolist()) for k in range(n)]
    imus = [bags.imu(99.9 + 0.02 * k, (0.0, 0.0, 2.0)) for k in range(round(last_imu * 50))]
    odometry = [bags.odometry(100.0 + 0.1 * k, (0.1 * k, 0.0, 0.0)) for k in range(n)]
    return [*scans, *imus, *(odometry if with_odometry else ())]


def test_the_imu_of_a_bag_is_integrated_to_the_scans(tmp_path: Path) -> None:
    log = read_log(bags.write_bag(tmp_path, said(20, last_imu=3.0)))
    assert log.gyro is not None
    np.testing.assert_allclose(log.gyro[:, 2], 0.2 * np.arange(20), atol=1e-6)
    assert log.choices["gyro"] == "/imu (Imu), 150 messages: odometry of the heading, if the scans confirm it"
    assert "gyro      turn rates: odometry of the heading" in str(describe_log(log))


def test_an_imu_beside_odometry_is_said_not_to_be_used(tmp_path: Path) -> None:
    log = read_log(bags.write_bag(tmp_path, said(20, last_imu=3.0, with_odometry=True)))
    assert log.has_odometry
    assert log.choices["gyro"] == "not used, as there is odometry: /imu (Imu), 150 messages"


def test_an_imu_that_ends_halfway_is_not_used(tmp_path: Path) -> None:
    log = read_log(bags.write_bag(tmp_path, said(40, last_imu=1.5)))
    assert log.gyro is None
    assert log.choices["gyro"].startswith("not used: /imu (Imu), 75 messages, which tell of ")


@pytest.mark.parametrize("name", ["log.csv", "log.npz", "log.parquet"])
def test_tables_carry_turn_rates(tmp_path: Path, name: str) -> None:
    log, _ = thinned("room", 20)
    assert write_log(tmp_path / name, log) == ()
    again = read_log(tmp_path / name).gyro
    assert again is not None
    np.testing.assert_array_equal(again, log.gyro)


@pytest.mark.parametrize("name", ["log.clf", "log.usarsim", "log.dpslam", "log.bag", "log.mcap"])
def test_formats_that_cannot_carry_turn_rates_say_so(tmp_path: Path, name: str) -> None:
    log, _ = thinned("room", 20)
    assert any("cannot carry the turn rates of the gyro" in lost for lost in write_log(tmp_path / name, log))


def test_one_column_of_turns_is_about_the_vertical_axis() -> None:
    log = Log.from_arrays(np.ones((4, 9)), field_of_view=3.0, gyro=[0.0, 0.5, 1.0, 1.5])
    np.testing.assert_array_equal(log.gyro, [[0, 0, 0], [0, 0, 0.5], [0, 0, 1], [0, 0, 1.5]])


@pytest.mark.parametrize("gyro", [np.zeros((4, 2)), np.zeros((3, 3)), np.full((4, 3), np.nan), np.full(4, 1e12)])
def test_turns_that_are_none_are_refused(gyro: NDArray[np.float64]) -> None:
    with pytest.raises(ScanError, match=r"gyro|turn rates"):
        Log.from_arrays(np.ones((4, 9)), field_of_view=3.0, gyro=gyro)
