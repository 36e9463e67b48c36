"""What a first pass tells of the steps that odometry does not know, and what the second makes of it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.measurement import RelativePose
from graph.se2 import between, compose
from iceg.evaluation.regression.cells import Cell
from iceg.evaluation.regression.recordings import recording_of
from iceg.evaluation.regression.runner import outcomes
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.foretold_steps import foretold_steps
from iceg.slam.odometry.velocity import motions_without_odometry
from iceg.slam.track import Track
from tests.test_velocity import room_log, stamps_of, tracked, unseen

CONFIG = CalibrationConfig()


def chained(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    pose = np.zeros(3)
    for step in steps:
        pose = compose(pose, step)
    return pose


def slid(track: Track, number: int, by: float, sigma: float, unobserved: int = 0) -> Track:
    """The same where the match of one key scan is off along [m], claims so much there, and does not see one axis."""
    key = track.keys[number]
    assert isinstance(key.match, RelativePose)
    weak = np.eye(3)[[unobserved]]
    covariance = np.diag([sigma**2, 1e-6, 1e-6])
    shift = np.array([by, 0.0, 0.0])
    match = replace(
        key.match, T_ref_cur=compose(key.match.T_ref_cur, shift), covariance=covariance, weak_directions=weak
    )
    keys = [
        key if k < number else replace(key, T_track_robot=compose(key.T_track_robot, shift))
        for k, key in enumerate(track.keys)
    ]
    keys[number] = replace(keys[number], match=match)
    return replace(track, keys=keys)


def test_where_matches_see_all_there_is_nothing_to_foretell() -> None:
    assert foretold_steps(tracked(room_log([0.05] * 60)), np.arange(60) / 10.0, CONFIG) is None


def test_a_step_that_nothing_saw_is_what_the_velocity_says() -> None:
    track = unseen(tracked(room_log([0.05] * 120)), {6})
    steps, motion = (
        foretold_steps(track, stamps_of(track), CONFIG),
        motions_without_odometry(track, stamps_of(track), CONFIG)[5],
    )
    assert steps is not None
    assert motion is not None
    first, last = (track.keys[k].index for k in (5, 6))
    np.testing.assert_allclose(chained(steps[first:last]), motion.T_key_robot, atol=1e-4)


def test_a_match_that_slid_is_put_back_as_far_as_it_does_not_know_better() -> None:
    track = tracked(room_log([0.05] * 120))
    first, last = (track.keys[k].index for k in (5, 6))
    went = 0.05 * (last - first)
    for sigma, unobserved, off in ((1.0, 0, 0.0), (1e-4, 0, 0.0), (1e-4, 1, 0.2)):
        steps = foretold_steps(slid(track, 6, 0.2, sigma, unobserved), stamps_of(track), CONFIG)
        assert steps is not None
        assert abs(chained(steps[first:last])[0] - went - off) < 0.03


def test_all_other_steps_are_as_they_were_tracked() -> None:
    track = slid(tracked(room_log([0.05] * 120)), 6, 0.2, 1.0)
    steps = foretold_steps(track, stamps_of(track), CONFIG)
    assert steps is not None
    poses = track.trajectory(np.array([key.T_track_robot for key in track.keys]))
    others = np.ones(len(steps), dtype=np.bool_)
    others[track.keys[5].index : track.keys[6].index] = False
    np.testing.assert_allclose(steps[others], between(poses[:-1], poses[1:])[others], atol=1e-12)


@pytest.mark.parametrize(("seed", "most"), [(306, 0.15), (115, 0.4)])
def test_a_robot_without_odometry_does_not_slide_along(seed: int, most: float) -> None:
    """A campus and a maze in which matches slid along walls; 0.45 and 0.92 m off when they were tracked once."""
    cell = Cell(group="random", source=f"random:{seed}")
    (outcome,) = outcomes(recording_of(cell, None), [cell])
    assert outcome.error_m < most, outcome.nees


def test_where_odometry_is_dead_steps_are_foretold_and_nowhere_else() -> None:
    track = unseen(tracked(room_log([0.05] * 120)), {3, 8})
    first, last = track.keys[7].index, track.keys[8].index
    assert foretold_steps(replace(track, dead=[(100, 110)]), stamps_of(track), CONFIG) is None  # seen by the matches
    steps = foretold_steps(replace(track, dead=[(first, last)]), stamps_of(track), CONFIG)
    as_if_none = foretold_steps(track, stamps_of(track), CONFIG)
    assert steps is not None
    assert as_if_none is not None
    np.testing.assert_array_equal(steps[first:last], as_if_none[first:last])
    poses = track.trajectory(np.array([key.T_track_robot for key in track.keys]))
    known = np.ones(len(steps), dtype=np.bool_)
    known[first:last] = False
    np.testing.assert_allclose(steps[known], between(poses[:-1], poses[1:])[known], atol=1e-12)


@pytest.mark.parametrize("seed", [107, 351])
def test_a_robot_whose_odometry_dies_does_not_slide_along(seed: int) -> None:
    """1.65 and 0.69 m off when it was tracked once."""
    cell = Cell(group="random", source=f"random:{seed}", fault="odometry dies")
    (outcome,) = outcomes(recording_of(cell, None), [cell])
    assert outcome.error_m < 0.1, outcome.nees
