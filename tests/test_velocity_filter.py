"""The velocity of a robot that nothing but matches tells."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.se2 import compose
from iceg.ice.matcher import IceMatcher
from iceg.slam.config import FrontEndConfig
from iceg.slam.tracking.front_end import FrontEnd
from iceg.slam.tracking.velocity_filter import VelocityFilter
from iceg.slam.tracking_config import VelocityFilterConfig
from tests.walls import CORRIDOR, see

Floats = NDArray[np.float64]

CONFIG = VelocityFilterConfig()
SURE = 1e8 * np.eye(2)
WALLS_BESIDE = np.diag([0.0, 1e8])
NOTHING = np.zeros((2, 2))


def textbook(velocity: Floats, turns: Floats, offsets: Floats, informations: Floats) -> Floats:
    """(n, 2) the velocities that the equations of Kalman give, whole matrices at a time."""
    config, found = CONFIG, []
    state = np.array([0.0, 0.0, *velocity])
    floor = config.match_deviation**2
    spread = np.diag([floor, floor, config.ahead_at_first**2, config.aside_at_first**2])
    for turn, offset, information in zip(turns, offsets, informations, strict=True):
        kept = np.diag([1.0, config.kept_aside])
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, s], [-s, c]])
        step = np.block([[rotation, rotation @ kept], [np.zeros((2, 2)), kept]])
        shaken = np.vstack([rotation, np.eye(2)])
        change = np.diag([config.change_ahead**2, config.change_aside**2])
        spread = step @ spread @ step.T + shaken @ change @ shaken.T
        state = np.array([0.0, 0.0, *(kept @ state[2:])])
        measured = config.points_together * np.linalg.inv(information + 1e-2 * np.eye(2)) + floor * np.eye(2)
        gain = spread[:, :2] @ np.linalg.inv(spread[:2, :2] + measured)
        state += gain @ offset
        spread -= gain @ spread[:2]
        found.append(state[2:].copy())
    return np.array(found)


@given(seed=st.integers(0, 10_000))
def test_it_is_the_filter_of_kalman(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 12
    roots = rng.normal(0.0, 10.0 ** rng.uniform(-1.0, 3.0, (n, 1, 1)), (n, 2, 2))
    turns, offsets, informations = rng.uniform(-1.0, 1.0, n), rng.normal(0.0, 0.2, (n, 2)), roots @ roots.swapaxes(1, 2)
    start = rng.normal(0.0, 0.3, 2)
    velocity, found = VelocityFilter(start, CONFIG), []
    for turn, offset, information in zip(turns, offsets, informations, strict=True):
        velocity.step(float(turn))
        velocity.correct(offset, information)
        found.append(velocity.velocity)
    np.testing.assert_allclose(found, textbook(start, turns, offsets, informations), rtol=1e-7, atol=1e-9)


def test_a_wall_found_again_makes_up_for_many_steps_not_for_one() -> None:
    velocity = VelocityFilter(np.array([0.1, 0.0]), CONFIG)
    for _ in range(10):  # along a corridor nothing says that the robot goes at 0.14
        velocity.step(0.0)
        velocity.correct(np.zeros(2), WALLS_BESIDE)
    velocity.step(0.0)
    velocity.correct(np.array([0.4, 0.0]), SURE)
    ahead, aside = velocity.velocity
    assert 0.11 < ahead < 0.2
    assert abs(aside) < 1e-6


def test_a_robot_seen_from_all_sides_goes_as_it_is_matched() -> None:
    velocity = VelocityFilter(np.zeros(2), CONFIG)
    for _ in range(30):
        expected = velocity.step(0.1)
        velocity.correct(np.array([0.3 - expected[0], -expected[1]]), SURE)
    assert velocity.velocity[0] == pytest.approx(0.3, abs=0.01)


def test_a_robot_between_two_walls_is_told_by_its_turn_that_it_stands() -> None:
    velocity = VelocityFilter(np.array([0.1, 0.0]), CONFIG)
    heading = 0.0
    for _ in range(12):  # on the spot, a sixth of a turn every four steps: the walls do not move
        expected = velocity.step(0.14)
        heading += 0.14
        normal = np.array([np.sin(heading), np.cos(heading)])  # of the walls, in the robot's frame
        velocity.correct(-(expected[:2] @ normal) * normal, 1e8 * np.outer(normal, normal))
    assert np.abs(velocity.velocity).max() < 0.03


@given(turn=st.floats(-3.0, 3.0), ahead=st.floats(-1.0, 1.0), aside=st.floats(-1.0, 1.0))
def test_where_nothing_is_seen_a_robot_goes_on_and_ever_less_to_its_side(
    turn: float, ahead: float, aside: float
) -> None:
    velocity = VelocityFilter(np.array([ahead, aside]), CONFIG)
    for step in range(1, 4):
        expected = velocity.step(turn)
        velocity.correct(np.zeros(2), NOTHING)
        np.testing.assert_allclose(expected, [ahead, aside * CONFIG.kept_aside**step, turn], atol=1e-12)


@given(turn=st.floats(-0.3, 0.3), ahead=st.floats(0.0, 1.0), steps=st.integers(1, 5))
def test_a_way_is_as_many_steps(turn: float, ahead: float, steps: int) -> None:
    one, other = (VelocityFilter(np.array([ahead, 0.0]), CONFIG) for _ in range(2))
    way = np.zeros(3)
    for _ in range(steps):
        way = compose(way, one.step(turn))
    np.testing.assert_allclose(other.way(turn, steps), way, atol=1e-12)
    for velocity in (one, other):
        velocity.correct(np.array([0.1, 0.0]), SURE)
    np.testing.assert_array_equal(one.velocity, other.velocity)


def test_nobody_goes_on_as_before_for_ever() -> None:
    """An hour later a robot may be anywhere."""
    assert VelocityFilter(np.array([0.1, 0.0]), CONFIG).way(0.0, 36_000)[0] == pytest.approx(10.0)


def test_a_scan_measures_a_position_across_its_walls_and_not_along() -> None:
    """Two walls along x, a metre away on either side: every point tells of y, and the robot is turned."""
    geometry = ScanGeometry(bearings=np.radians(np.arange(-179.5, 180.0)), range_min=0.1, range_max=10.0)
    heading = 0.6
    bearings = geometry.bearings + heading
    with np.errstate(divide="ignore"):
        ranges = 1.0 / np.abs(np.sin(bearings))
    scan = Scan(ranges=np.where(ranges < 5.0, ranges, np.nan).astype(np.float32), geometry=geometry)
    pose = np.array([0.0, 0.0, heading])
    matcher = IceMatcher()
    information = matcher.position_information(matcher.prepare([scan], pose[None]), scan, pose)
    values, axes = np.linalg.eigh(information)
    assert values[0] < 1e-3 * values[1]
    assert abs(axes[:, 1] @ [np.sin(heading), np.cos(heading)]) == pytest.approx(1.0, abs=1e-3)
    assert 0.3 < values[1] * 0.004**2 / np.isfinite(scan.ranges).sum() < 1.1


def test_a_robot_that_turns_in_a_corridor_without_odometry_stays_where_it_is() -> None:
    """It comes from where an end of the corridor shows how fast it goes, to where nothing does, and turns there."""
    walls = np.vstack([CORRIDOR, [[-40, -1, -40, 1]]])
    there = np.column_stack([np.linspace(-38.0, -18.0, 201), np.zeros(201), np.full(201, np.pi)])
    turns = np.column_stack([np.full(45, -18.0), np.zeros(45), np.pi + 0.14 * np.arange(1, 46)])
    front_end = FrontEnd(IceMatcher(), None, FrontEndConfig())
    truth = np.vstack([there, turns])
    tracked = np.array([front_end.add(k, see(walls, pose, seed=k), None) for k, pose in enumerate(truth)])
    assert np.hypot(*(tracked[200, :2] - tracked[0, :2])) == pytest.approx(20.0, abs=0.2)
    assert np.hypot(*(tracked[200:, :2] - tracked[200, :2]).T).max() < 0.6
    assert not front_end.lost
