"""A delay of several scans is found by turns, where it clearly explains them and nothing else can."""

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.se2 import wrap_angle
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.delay import whole_delay

Array = NDArray[np.float64]

_N, _EVERY = 400, 3


def _drive(turns: float = 0.3) -> Array:
    """Straight on, with smooth turns that last some ten scans, (n, 3)."""
    rng = np.random.default_rng(1)
    rate = np.convolve(turns * (rng.random(_N + 8) < 0.05) * rng.choice([-1.0, 1.0], _N + 8), np.hanning(9), "valid")
    poses = np.zeros((_N, 3))
    poses[:, 2] = np.cumsum(rate)
    poses[1:, 0] = np.cumsum(0.1 * np.cos(poses[:-1, 2]))
    poses[1:, 1] = np.cumsum(0.1 * np.sin(poses[:-1, 2]))
    return poses


def _found(truth: Array, odometry: Array, wrong: float = 0.0) -> int:
    """Where matches tell the truth, but for a share of them that turn anyhow."""
    rng = np.random.default_rng(2)
    starts = np.arange(0, _N - _EVERY, _EVERY)
    turns = truth[starts + _EVERY, 2] - truth[starts, 2] + rng.normal(0.0, 0.003, len(starts))
    turns += rng.uniform(-3.0, 3.0, len(starts)) * (rng.random(len(starts)) < wrong)
    claimed = odometry.copy()
    claimed[:, 2] = wrap_angle(claimed[:, 2])
    return whole_delay(turns, starts, starts + _EVERY, claimed, CalibrationConfig())


def _late(poses: Array, scans: int) -> Array:
    return poses[np.clip(np.arange(_N) - scans, 0, _N - 1)]


@pytest.mark.parametrize("scans", [-12, -3, 0, 2, 5, 16])
@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_whole_scans_are_found(scans: int, wrong: float) -> None:
    truth = _drive()
    assert _found(truth, _late(truth, scans), wrong) == scans


def test_a_fraction_of_a_scan_is_left_to_the_linear_fit() -> None:
    truth = _drive()
    halfway = truth.copy()
    halfway[1:] = 0.5 * (truth[1:] + truth[:-1])
    assert _found(truth, halfway) == 0


@pytest.mark.parametrize("scans", [-1, 1])
def test_a_single_scan_is_left_to_it_too(scans: int) -> None:
    truth = _drive()
    assert _found(truth, _late(truth, scans)) == 0


def test_who_goes_straight_on_tells_nothing() -> None:
    truth = _drive(turns=0.0)
    assert _found(truth, _late(truth, 5)) == 0


def test_nothing_is_looked_for_where_odometry_jumps() -> None:
    truth = _drive()
    late = _late(truth, 5)
    late[200:, 0] += 30.0
    assert _found(truth, late) == 0
