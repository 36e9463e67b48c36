"""How far a robot may have gone since the newest match."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from iceg.slam.tracking.reach import Reach, UsualReach
from iceg.slam.tracking_config import OdometryCheckConfig

_NONE = OdometryCheckConfig(reach_distance=1e-9, reach_turn=1e-9)
"""All that a robot gets is what its matches say."""


@given(way=st.floats(0.0, 50.0), turn=st.floats(-3.0, 3.0), most=st.floats(0.01, 10.0), carried=st.floats(1e-6, 0.5))
def test_a_way_is_as_probable_as_a_normal_step_or_a_robot_that_is_carried(
    way: float, turn: float, most: float, carried: float
) -> None:
    reach = Reach(T_track_before=np.zeros(3), most=np.array([most, 2.0 * most]))
    told = reach.log_probability(np.array([0.6 * way, 0.8 * way, turn]), carried)
    normal = math.exp(-0.5 * ((way / most) ** 2 + (turn / (2.0 * most)) ** 2))
    assert told == pytest.approx(math.log((1.0 - carried) * normal + carried), abs=1e-9)
    assert reach.log_probability(np.zeros(3), carried) == pytest.approx(0.0, abs=1e-12)


def test_steps_without_a_match_reach_farther_from_where_the_newest_one_was() -> None:
    reach = Reach(T_track_before=np.array([1.0, 2.0, 0.5]), most=np.zeros(2))
    for _ in range(5):
        reach = reach.after(np.array([0.1, 0.2]))
    np.testing.assert_allclose(reach.most, [0.5, 1.0])
    assert reach.T_track_before.tolist() == [1.0, 2.0, 0.5]
    assert reach.log_probability(np.array([1.5, 2.0, 0.5]), 1e-9) == pytest.approx(-0.5, abs=1e-6)


def _straight(step: float, n: int) -> NDArray[np.float64]:
    return np.column_stack([step * np.arange(n + 1.0), np.zeros(n + 1), np.zeros(n + 1)])


def test_a_robot_reaches_as_far_as_odometry_says_and_never_less_than_any_robot() -> None:
    usual = UsualReach(OdometryCheckConfig())
    assert usual.most.tolist() == [0.1, 0.2]
    usual.expect(np.array([0.5, 0.05]))
    assert usual.most.tolist() == [0.5, 0.2]


def test_it_reaches_as_far_as_matches_say_where_odometry_hardly_counts() -> None:
    usual = UsualReach(OdometryCheckConfig())
    usual.add(_straight(1.0, 1))
    np.testing.assert_allclose(usual.most, [2.0, 0.2])


@given(steps=st.lists(st.floats(0.0, 2.0), min_size=1, max_size=64))
def test_steps_count_alike_told_one_by_one_or_together(steps: list[float]) -> None:
    poses = np.zeros((len(steps) + 1, 3))
    poses[1:, 0] = np.cumsum(steps)
    together, one_by_one = UsualReach(_NONE), UsualReach(_NONE)
    together.add(poses)
    for k in range(len(steps)):
        one_by_one.add(poses[k : k + 2])
    np.testing.assert_allclose(one_by_one.most, together.most, atol=1e-9)
    np.testing.assert_allclose(together.most, [2.0 * sum(steps) / len(steps), 0.0], atol=1e-8)


def test_one_wrong_match_among_many_hardly_moves_it() -> None:
    usual = UsualReach(OdometryCheckConfig())
    usual.add(_straight(0.05, 200))
    usual.add(np.array([[0.0, 0.0, 3.0], [0.8, 0.0, -3.0]]))
    assert usual.most[0] < 0.13
    assert usual.most[1] == 0.2
