"""People who walk, and what the laser sees of them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from frontends.simulator.laser import Laser, sense, sick_lms200
from frontends.simulator.people import LEG_RADIUS, Person, walk
from frontends.simulator.robot import Driving, drive
from frontends.simulator.scene import load_scene
from frontends.simulator.simulation import simulate
from frontends.simulator.world import SimulatorError, World

EXACT = Laser(range_std=0.0, range_std_per_metre=0.0, quantisation=0.0, mixed_share=0.0)
TIMES = np.arange(0.0, 40.0, 0.2)
FAR_AWAY = np.broadcast_to([100.0, 100.0, 0.0], (len(TIMES), 3))


def test_a_person_walks_to_and_fro_at_the_given_speed() -> None:
    legs = walk([Person(path=((0, 0), (6, 0)), speed=1.0)], FAR_AWAY, TIMES)
    assert legs.shape == (len(TIMES), 2, 2)
    body = legs.mean(axis=1)
    expected = np.abs((TIMES + 6) % 12 - 6)
    np.testing.assert_allclose(body[:, 0], expected, atol=1e-9)
    np.testing.assert_allclose(body[:, 1], 0.0, atol=1e-9)


def test_a_closed_path_is_walked_round() -> None:
    square = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0))
    body = walk([Person(path=square, speed=1.0)], FAR_AWAY, TIMES).mean(axis=1)
    np.testing.assert_allclose(body[TIMES == 5.0], [(1.0, 2.0)], atol=1e-9)
    np.testing.assert_allclose(body[40], body[0], atol=1e-9)


def test_legs_swing_against_each_other_beside_the_body() -> None:
    legs = walk([Person(path=((0, 0), (50, 0)))], FAR_AWAY, TIMES)
    apart = legs[:, 0] - legs[:, 1]
    np.testing.assert_allclose(np.abs(apart[:, 1]), 0.2, atol=1e-9)
    assert np.abs(apart[:, 0]).max() > 0.4
    assert np.abs(apart[:, 0]).min() < 0.1
    assert apart[:, 0].min() < -0.4


def test_nobody_is_there_before_coming_or_after_leaving() -> None:
    legs = walk([Person(path=((0, 0), (6, 0)), appears=4.0, vanishes=8.0)], FAR_AWAY, TIMES)
    there = np.isfinite(legs).all(axis=(1, 2))
    np.testing.assert_array_equal(there, (TIMES >= 4.0) & (TIMES < 8.0))


def test_nobody_walks_into_the_robot_or_is_run_over() -> None:
    standing = np.broadcast_to([3.0, 0.0, 0.0], (len(TIMES), 3))
    coming = np.column_stack([6.0 - 0.3 * TIMES, 0.1 + 0 * TIMES, 0 * TIMES])
    for robot in (standing, coming):
        body = walk([Person(path=((0, 0), (6, 0)), speed=1.0)], robot, TIMES).mean(axis=1)
        assert np.hypot(*(body - robot[:, :2]).T).min() >= 0.75 - 1e-9
    assert np.ptp(walk([Person(path=((0, 0), (6, 0)))], standing, TIMES).mean(axis=1)[20:, 0]) == 0


def test_in_the_building_people_keep_clear_of_the_robot_and_of_walls() -> None:
    scene = load_scene("building")
    truth = drive(scene.route, Driving(), 0.2, np.random.default_rng(2))[:3000]
    legs = walk(scene.people, truth, 0.2 * np.arange(len(truth), dtype=np.float64))
    assert legs.shape[1] == 2 * len(scene.people) >= 4
    assert np.hypot(*np.moveaxis(legs - truth[:, None, :2], -1, 0)).min() > 0.4
    own_way = np.concatenate([np.array(person.path) for person in scene.people])
    assert scene.world.clearance(own_way).min() > 0.3


def test_the_laser_sees_legs_as_round_and_before_the_wall() -> None:
    wall = World.empty().with_segments(np.array([[5.0, -9, 5, 9]]))
    legs = np.array([[[2.16, 0.0], [3.16, 1.0]]])
    ranges = sense(wall, np.zeros((1, 3)), EXACT, np.random.default_rng(0), legs=legs)[0].astype(float)
    geometry = sick_lms200()
    ahead = 90
    assert ranges[ahead] == pytest.approx(2.0 - LEG_RADIUS, abs=1e-6)
    points = geometry.origin_robot + ranges[:, None] * geometry.directions_robot
    for centre in legs[0]:
        on_leg = np.hypot(*(points - centre).T) < LEG_RADIUS + 1e-5
        assert on_leg.sum() >= 2
        np.testing.assert_allclose(np.hypot(*(points[on_leg] - centre).T), LEG_RADIUS, atol=1e-5)
    far = np.isfinite(ranges) & (np.hypot(*(points - legs[0, 0]).T) > 0.2) & (np.hypot(*(points - legs[0, 1]).T) > 0.2)
    np.testing.assert_allclose(points[far, 0], 5.0, atol=1e-5)


def test_a_leg_that_holds_the_laser_and_an_absent_one_are_not_seen() -> None:
    legs = np.array([[[0.16, 0.0], [math.nan, math.nan]]])
    assert np.isnan(sense(World.empty(), np.zeros((1, 3)), EXACT, np.random.default_rng(0), legs=legs)).all()


def test_people_show_in_the_scans_of_a_drive() -> None:
    scene = load_scene("building")
    short = replace(scene, route=replace(scene.route, duration=30.0))
    with_people, alone = (simulate(where, 0, laser=EXACT).log for where in (short, replace(short, people=())))
    nearer = np.nan_to_num(alone.ranges, nan=99.0) - np.nan_to_num(with_people.ranges, nan=99.0)
    assert nearer.min() == 0.0
    assert (nearer > 0).any(axis=1).sum() > 20


@pytest.mark.parametrize(
    ("person", "message"),
    [
        ({"path": ((0, 0), (0, 0))}, "two different points"),
        ({"path": ((0, 0),)}, "two different points"),
        ({"path": ((0, 0), (1, 0)), "speed": 0.0}, "speed must be positive"),
    ],
)
def test_people_who_cannot_be(person: dict[str, object], message: str) -> None:
    with pytest.raises(SimulatorError, match=message):
        Person(**person)  # type: ignore[arg-type]


def test_without_people_there_are_no_legs() -> None:
    assert walk([], FAR_AWAY, TIMES).shape == (len(TIMES), 0, 2)
