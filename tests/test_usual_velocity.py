"""How fast a robot usually goes while it turns as it does."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from graph.se2 import wrap_angle
from iceg.slam.odometry.usual_velocity import usual_velocities

Floats = NDArray[np.float64]


def drive(seed: int, n: int, ahead: float = 0.0) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """A robot that stops to turn, its laser so far ahead of the axle [m]: velocities, turns, starts."""
    rng = np.random.default_rng(seed)
    scans = rng.integers(3, 9, n)
    starts = np.cumsum(scans) - scans
    is_turning = np.repeat(rng.random(n) < 0.3, scans)
    turns = np.where(is_turning, rng.choice([-0.15, 0.15], scans.sum()), rng.normal(0.0, 1e-3, scans.sum()))
    along, across = np.where(is_turning, 0.0, 0.08), ahead * turns
    steps = np.column_stack([along, across, turns])
    return np.add.reduceat(steps, starts) / scans[:, None], turns, starts


def test_a_robot_that_turns_on_the_spot_is_expected_to_stand_where_it_turns() -> None:
    velocities, turns, starts = drive(1, 80)
    seen = np.random.default_rng(2).random(80) < 0.6
    usual = usual_velocities(velocities, turns, np.ones(len(turns)), starts, seen)
    np.testing.assert_allclose(usual[:, 0], velocities[:, 0], atol=0.008)
    from_the_mean = np.abs(velocities[~seen, 0] - velocities[seen, 0].mean())
    assert np.abs(usual[~seen, 0] - velocities[~seen, 0]).mean() < 0.2 * from_the_mean.mean()


def test_a_laser_ahead_of_the_axle_goes_aside_as_the_robot_turns() -> None:
    velocities, turns, starts = drive(3, 80, ahead=0.3)
    usual = usual_velocities(velocities, turns, np.ones(len(turns)), starts, np.arange(80) < 50)
    np.testing.assert_allclose(usual[50:, 1], velocities[50:, 1], atol=0.002)


@given(seed=st.integers(0, 10_000), n=st.integers(2, 40))
def test_what_nobody_sees_tells_nothing(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    velocities, turns, starts = drive(seed, n)
    seen = rng.random(n) < 0.5
    others = np.where(seen[:, None], velocities, rng.normal(0.0, 10.0, velocities.shape))
    found, again = (usual_velocities(each, turns, np.ones(len(turns)), starts, seen) for each in (velocities, others))
    np.testing.assert_array_equal(found, again)
    assert np.isfinite(found).all()


@given(seed=st.integers(0, 10_000), n=st.integers(3, 40), speed=st.floats(-1.0, 1.0))
def test_a_robot_that_always_goes_as_fast_is_expected_to(seed: int, n: int, speed: float) -> None:
    _, turns, starts = drive(seed, n)
    velocities = np.full((n, 3), speed)
    usual = usual_velocities(velocities, turns, np.ones(len(turns)), starts, np.ones(n, dtype=np.bool_))
    np.testing.assert_allclose(usual, velocities, atol=1e-9)


@pytest.mark.parametrize("n", [0, 4])
def test_where_no_step_is_seen_the_robot_is_not_known_to_move(n: int) -> None:
    velocities, turns, starts = drive(5, max(n, 1))
    usual = usual_velocities(velocities[:n], turns, np.ones(len(turns)), starts[:n], np.zeros(n, dtype=np.bool_))
    np.testing.assert_array_equal(usual, np.zeros((n, 3)))


def test_a_scan_that_comes_late_is_no_faster_turn() -> None:
    """Two scans left out of every three: the same robot, seen more seldom."""
    velocities, turns, starts = drive(7, 40)
    seen, dense = np.arange(40) < 30, np.repeat(turns, 3) / 3.0
    often = usual_velocities(velocities / 3.0, dense, np.ones(len(dense)), 3 * starts, seen)
    seldom = usual_velocities(velocities / 3.0, turns, np.full(len(turns), 3.0), starts, seen)
    np.testing.assert_allclose(seldom, often, atol=1e-12)


@given(seed=st.integers(0, 10_000))
def test_left_turns_and_right_turns_are_alike(seed: int) -> None:
    velocities, turns, starts = drive(seed, 30, ahead=0.2)
    seen = np.ones(30, dtype=np.bool_)
    usual = usual_velocities(velocities, turns, np.ones(len(turns)), starts, seen)
    mirrored = usual_velocities(velocities * [1.0, -1.0, -1.0], wrap_angle(-turns), np.ones(len(turns)), starts, seen)
    np.testing.assert_allclose(mirrored, usual * [1.0, -1.0, -1.0], atol=1e-12)
