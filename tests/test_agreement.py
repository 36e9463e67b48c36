"""Whether poses agree: one answer for one pose and for many, whatever the frame, and across the turn of the angle."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from graph.se2 import between, compose
from iceg.slam.agreement import Tolerance, agree, apart, are_small, is_small

_PLACES = st.floats(-50.0, 50.0)
_POSES = st.tuples(_PLACES, _PLACES, st.floats(-math.pi, math.pi)).map(np.array)
_TOLERANCE = Tolerance(0.5, 0.1)


@given(_POSES, st.floats(0.0, 1.0), st.floats(-math.pi, math.pi), st.floats(-0.3, 0.3))
def test_poses_agree_that_are_less_apart_than_the_tolerance(
    pose: NDArray[np.float64], distance: float, towards: float, turn: float
) -> None:
    if abs(distance - _TOLERANCE.distance) < 1e-9 or abs(abs(turn) - _TOLERANCE.turn) < 1e-9:
        return  # rounding decides
    offset = np.array([distance * math.cos(towards), distance * math.sin(towards), turn])
    expected = distance < _TOLERANCE.distance and abs(turn) < _TOLERANCE.turn
    assert is_small(offset, _TOLERANCE) == expected
    assert agree(pose, compose(pose, offset), _TOLERANCE) == expected
    assert agree(compose(pose, offset), pose, _TOLERANCE) == expected


@given(_POSES, _POSES, _POSES)
def test_the_frame_does_not_matter(
    frame: NDArray[np.float64], one: NDArray[np.float64], other: NDArray[np.float64]
) -> None:
    np.testing.assert_allclose(apart(compose(frame, one), compose(frame, other)), apart(one, other), atol=1e-9)


@given(st.lists(_POSES, min_size=1, max_size=5))
def test_many_are_judged_as_each_is(poses: list[NDArray[np.float64]]) -> None:
    offsets = between(poses[0], np.array(poses))
    assert are_small(offsets, _TOLERANCE).tolist() == [is_small(offset, _TOLERANCE) for offset in offsets]


def test_headings_on_either_side_of_half_a_turn_agree() -> None:
    assert agree(np.array([0.0, 0.0, math.pi - 0.01]), np.array([0.0, 0.0, 0.01 - math.pi]), _TOLERANCE)


def test_a_tolerance_is_the_deviations_of_a_search() -> None:
    np.testing.assert_array_equal(_TOLERANCE.deviations, [0.5, 0.5, 0.1])
