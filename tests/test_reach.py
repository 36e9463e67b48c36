"""How far a robot may have gone since the newest match."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iceg.slam.tracking.reach import Reach


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
