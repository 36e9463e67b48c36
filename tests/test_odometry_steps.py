"""Steps of the odometry that stand out."""

import numpy as np
from numpy.typing import NDArray

from graph.odometry import OdometryModel
from graph.se2 import compose
from iceg.slam.calibration_config import SuddenStepConfig
from iceg.slam.odometry.calibration import OdometryCalibration
from iceg.slam.recording.steps import late_steps, sudden_steps, usual_reach

CONFIG = SuddenStepConfig()


def _driven(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


def _usual(n: int = 300) -> NDArray[np.float64]:
    rng = np.random.default_rng(3)
    return np.column_stack([rng.uniform(0.0, 0.2, n), np.zeros(n), rng.normal(0.0, 0.1, n)])


def test_a_jump_and_a_turn_stand_out_usual_driving_does_not() -> None:
    steps = _usual()
    steps[100, 0], steps[200, 2] = 5.0, 2.0
    assert np.flatnonzero(sudden_steps(_driven(steps), CONFIG)).tolist() == [100, 200]


def test_a_long_pause_explains_a_long_step() -> None:
    steps = _usual()
    steps[100, 0] = 5.0
    odometry, stamps = _driven(steps), 0.2 * np.arange(301.0)
    assert sudden_steps(odometry, CONFIG, stamps)[100]
    stamps[101:] += 10.0
    assert not sudden_steps(odometry, CONFIG, stamps).any()
    assert sudden_steps(odometry, CONFIG, np.zeros(301))[100]  # stamps that stall explain nothing


def test_a_pause_explains_no_more_than_usual_driving_makes_of_it() -> None:
    steps, stamps = _usual(), 0.2 * np.arange(301.0)
    for pause in range(10, 300, 20):  # more than one step in a hundred
        steps[pause, 0] = 1.0
        stamps[pause + 1 :] += 1.0
    steps[90, 0] = 9.0
    assert np.flatnonzero(sudden_steps(_driven(steps), CONFIG, stamps)).tolist() == [90]


def test_long_steps_are_usual_in_sparse_logs_and_short_logs_have_none() -> None:
    assert not sudden_steps(_driven(np.tile([2.0, 0.0, 0.9], (50, 1))), CONFIG).any()
    assert not len(sudden_steps(np.zeros((1, 3)), CONFIG, np.zeros(1)))


def test_a_robot_reaches_as_far_as_nearly_all_of_its_moves_whatever_the_pauses() -> None:
    steps, stamps = np.tile([0.1, 0.0, -0.2], (400, 1)), 0.2 * np.arange(401.0)
    steps[::2] = 0.0  # it stands half of the time
    steps[101] = [5.0, 0.0, 2.0]  # and jumps once
    np.testing.assert_allclose(usual_reach(_driven(steps), 0.99, stamps), [0.1, 0.2], atol=1e-9)
    steps[201], stamps[202:] = [2.0, 0.0, 0.0], stamps[202:] + 4.0
    np.testing.assert_allclose(usual_reach(_driven(steps), 0.99, stamps), [0.1, 0.2], atol=1e-9)
    assert not usual_reach(np.zeros((50, 3)), 0.99, np.arange(50.0)).any()
    assert not usual_reach(np.zeros((1, 3)), 0.99, np.zeros(1)).any()


def test_a_time_shift_does_not_smear_a_jump() -> None:
    steps = np.tile([0.1, 0.0, 0.0], (300, 1))
    steps[150] = [7.0, 2.0, 1.5]
    calibration = OdometryCalibration(translation_shift=-0.5, heading_shift=0.7, noise=OdometryModel())
    np.testing.assert_allclose(calibration.apply(_driven(steps), CONFIG), _driven(steps), atol=1e-9)


def test_odometry_may_catch_up_one_scan_after_a_pause_but_no_later() -> None:
    steps, stamps = _usual(), 0.2 * np.arange(301.0)
    stamps[101:] += 10.0  # the pause lies between scans 100 and 101
    for late, stands_out in ((0, False), (1, False), (2, True)):
        moved = steps.copy()
        moved[100 + late, 0] = 5.0
        assert sudden_steps(_driven(moved), CONFIG, stamps).any() == stands_out
        assert np.flatnonzero(late_steps(_driven(moved), CONFIG, stamps)).tolist() == ([101] if late == 1 else [])
