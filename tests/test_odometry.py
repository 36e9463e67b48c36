"""The odometry model: additive along a path, right in its closed forms, the same step by step and all at once."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from graph.errors import GraphError
from graph.odometry import OdometryModel
from graph.se2 import compose, expmap

Array = NDArray[np.float64]

MODEL = OdometryModel(
    along_per_metre=0.05,
    across_per_metre=0.02,
    position_per_radian=0.01,
    heading_per_metre=0.03,
    heading_per_radian=0.06,
    along_floor=0.004,
    across_floor=0.004,
    heading_floor=0.002,
)
INCREMENTS = st.integers(0, 2**32 - 1).map(
    lambda seed: np.random.default_rng(seed).normal(0.0, [0.2, 0.05, 0.3], size=(5, 3))
)


def step_by_step(model: OdometryModel, increments: Array) -> Array:
    motion = model.start()
    for T_prev_cur in increments:
        motion = model.extend(motion, T_prev_cur)
    return motion.covariance


@given(INCREMENTS)
def test_step_by_step_equals_all_at_once(increments: Array) -> None:
    np.testing.assert_allclose(step_by_step(MODEL, increments), MODEL.covariance(increments), atol=1e-12)


def test_many_motions_at_once() -> None:
    motions = np.random.default_rng(1).normal(size=(2, 3, 4, 3))
    found = MODEL.covariance(motions)
    assert found.shape == (2, 3, 3, 3)
    np.testing.assert_allclose(found[1, 2], MODEL.covariance(motions[1, 2]), atol=1e-12)


@given(INCREMENTS)
def test_covariance_is_symmetric_and_positive_definite_even_at_rest(increments: Array) -> None:
    for path in (increments, increments[:0], np.zeros((3, 3))):
        covariance = MODEL.covariance(path)
        np.testing.assert_array_equal(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance)[0] > 0


def test_motion_keeps_pose_path_length_and_turn() -> None:
    motion = MODEL.start()
    T_key_robot = np.zeros(3)
    for T_prev_cur in ([0.3, 0.4, 0.2], [-0.5, 0.0, -0.2]):
        motion = MODEL.extend(motion, np.array(T_prev_cur))
        T_key_robot = compose(T_key_robot, np.array(T_prev_cur))
    np.testing.assert_allclose(motion.T_key_robot, T_key_robot)
    assert motion.distance == pytest.approx(1.0)
    assert motion.turn == pytest.approx(0.4)


def test_straight_line_in_closed_form() -> None:
    # L metres in n steps: variance a²L along; heading h²L plus the floor f². The k-th heading error (h²L/n) swings the
    # (n − k)·L/n that follow, the floor all of L: across b²L + h²(L/n)³ Σ(n − k)² + f²L².
    length, n = 2.0, 8
    found = MODEL.covariance(np.tile([length / n, 0.0, 0.0], (n, 1)))
    swings = (np.arange(n) ** 2).sum() * (length / n) ** 3
    assert found[0, 0] == pytest.approx(0.05**2 * length + 0.004**2)
    assert found[1, 1] == pytest.approx(0.02**2 * length + 0.004**2 + 0.03**2 * swings + 0.002**2 * length**2)
    assert found[2, 2] == pytest.approx(0.03**2 * length + 0.002**2)


def test_turning_there_and_back_is_not_free() -> None:
    there_and_back = np.array([[0.0, 0.0, 0.7], [0.0, 0.0, -0.7]])
    found = MODEL.covariance(there_and_back)
    np.testing.assert_allclose(np.diag(found), [1.4 * 0.01**2 + 0.004**2] * 2 + [1.4 * 0.06**2 + 0.002**2])
    assert found[2, 2] > MODEL.covariance(np.zeros((1, 3)))[2, 2]


def test_path_counts_not_the_net_motion() -> None:
    out_and_home = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert MODEL.covariance(out_and_home)[0, 0] == pytest.approx(2 * 0.05**2 + 0.004**2)


def test_sideways_travel_is_uncertain_sideways() -> None:
    found = MODEL.covariance(np.array([[0.0, 1.0, 0.0]]))
    assert found[1, 1] == pytest.approx(0.05**2 + 0.004**2)
    assert found[0, 0] == pytest.approx(0.02**2 + 0.004**2 + 0.002**2)  # and the floor's heading over one metre


def test_direction_of_travel_is_seen_from_the_end() -> None:
    # One metre ahead with a quarter turn to the left at its end: seen from there, the travel was to the right.
    model = OdometryModel(heading_per_metre=0.0, heading_floor=1e-9, position_per_radian=0.0)
    found = model.covariance(np.array([[1.0, 0.0, math.pi / 2]]))
    assert found[1, 1] == pytest.approx(model.along_per_metre**2 + model.across_floor**2)
    assert found[0, 0] == pytest.approx(model.across_per_metre**2 + model.along_floor**2)


@pytest.mark.parametrize("n", [1, 3, 50])
def test_heading_and_length_do_not_depend_on_how_finely_a_curve_is_recorded(n: int) -> None:
    increments = np.tile(expmap(np.array([1.0, 0.0, 0.5]) / n), (n, 1))
    found = MODEL.covariance(increments)
    length = np.hypot(increments[:, 0], increments[:, 1]).sum()
    assert found[2, 2] == pytest.approx(0.03**2 * length + 0.06**2 * 0.5 + 0.002**2)


@pytest.mark.parametrize(
    ("name", "value"),
    [("along_per_metre", -0.1), ("heading_per_radian", math.nan), ("across_floor", 0.0), ("heading_floor", -1.0)],
)
def test_impossible_settings_are_named(name: str, value: float) -> None:
    with pytest.raises(GraphError, match=name):
        OdometryModel(**{name: value})
