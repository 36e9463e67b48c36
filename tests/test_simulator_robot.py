"""How the robot drives and what its wheels report."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.simulator.robot import Driving, OdometryModel, Route, Waypoint, drive, measure_odometry
from frontends.simulator.scene import SCENES, load_scene
from frontends.simulator.world import SimulatorError, World
from graph import se2

PERIOD = 0.2
PERFECT = OdometryModel(
    translation_scale=1.0,
    rotation_scale=1.0,
    heading_drift=0.0,
    translation_std=0.0,
    rotation_std=0.0,
    drift_std=0.0,
    slip_std=0.0,
)
STEADY = Driving(steering_std=0.0)


def test_a_straight_route_with_a_stop() -> None:
    route = Route(start=(0, 0, 0), waypoints=(Waypoint(x=3, y=0, pause=4.0), Waypoint(x=5, y=0)))
    truth = drive(route, STEADY, PERIOD, np.random.default_rng(0))
    np.testing.assert_array_equal(truth[0], [0, 0, 0])
    np.testing.assert_allclose(truth[:, 1:], 0.0, atol=1e-12)
    standing = np.diff(truth[:, 0]) == 0
    assert standing.sum() == pytest.approx(4.0 / PERIOD, abs=2)
    assert np.all(np.abs(truth[:-1, 0][standing] - 3) < 0.15)
    assert truth[-1, 0] == pytest.approx(5.0, abs=0.15)


def test_it_turns_on_the_spot_towards_what_lies_aside() -> None:
    route = Route(start=(1, 1, 0), waypoints=(Waypoint(x=1, y=4),))
    truth = drive(route, STEADY, PERIOD, np.random.default_rng(0))
    turning = np.abs(np.diff(truth[:, 2], prepend=0.0)) > math.radians(1)
    assert truth[turning, :2] == pytest.approx(np.ones((int(turning.sum()), 2)), abs=0.02)
    assert truth[-1] == pytest.approx(np.array([1, 4, math.pi / 2]), abs=0.15)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_are_driven_within_the_limits_clear_of_walls_and_past_every_waypoint(name: str) -> None:
    scene, limits = load_scene(name), Driving()
    once = replace(scene.route, laps=1, duration=None)
    for seed in range(1 if len(scene.world.segments) > 1000 else 4):
        truth = drive(once, limits, PERIOD, np.random.default_rng(seed))
        steps = se2.between(truth[:-1], truth[1:])
        assert np.hypot(steps[:, 0], steps[:, 1]).max() <= limits.speed * PERIOD * (1 + 1e-9)
        assert np.abs(steps[:, 2]).max() <= limits.turn_rate * PERIOD * (1 + 1e-9)
        assert np.all((truth[:, 2] > -math.pi) & (truth[:, 2] <= math.pi))
        assert _least_clearance(scene.world, truth) >= 0.25
        for goal in scene.route.waypoints:
            assert np.hypot(truth[:, 0] - goal.x, truth[:, 1] - goal.y).min() < 0.2


@pytest.mark.parametrize(("name", "scans"), [("rooms", 2126), ("corridor", 987)])
def test_scenes_of_the_paper_have_its_number_of_scans_whatever_the_seed(name: str, scans: int) -> None:
    route = load_scene(name).route
    for seed in range(4):
        assert len(drive(route, Driving(), PERIOD, np.random.default_rng(seed))) == scans
        unhurried = drive(replace(route, duration=None), Driving(), PERIOD, np.random.default_rng(seed))
        assert 0.95 * scans < len(unhurried) < 1.01 * scans


def test_a_drive_goes_on_for_laps_and_ends_when_it_is_told() -> None:
    goals = (Waypoint(x=2, y=0), Waypoint(x=0, y=0))
    lap = drive(Route(start=(0, 0, 0), waypoints=goals), STEADY, PERIOD, np.random.default_rng(0))
    laps = drive(Route(start=(0, 0, 0), waypoints=goals, laps=3), STEADY, PERIOD, np.random.default_rng(0))
    assert np.sum(np.diff(np.sign(laps[:, 0] - 1)) > 0) == 3
    short = drive(Route(start=(0, 0, 0), waypoints=goals, duration=4.0), STEADY, PERIOD, np.random.default_rng(0))
    np.testing.assert_array_equal(short, lap[:21])
    long = drive(Route(start=(0, 0, 0), waypoints=goals, duration=60.0), STEADY, PERIOD, np.random.default_rng(0))
    assert len(long) == 301
    np.testing.assert_array_equal(long[-5:], np.broadcast_to(long[-1], (5, 3)))


def test_a_period_that_no_tick_divides_is_refused() -> None:
    route = Route(start=(0, 0, 0), waypoints=(Waypoint(x=1, y=0),))
    with pytest.raises(SimulatorError, match=r"0\.05 s"):
        drive(route, STEADY, 0.05, np.random.default_rng(0))


def test_an_endless_way_is_given_up() -> None:
    route = Route(start=(0, 0, 0), waypoints=(Waypoint(x=1e6, y=0),))
    with pytest.raises(SimulatorError, match="did not reach waypoint"):
        drive(route, STEADY, PERIOD, np.random.default_rng(0))


def test_routes_and_speeds_that_cannot_be() -> None:
    with pytest.raises(SimulatorError, match="waypoint"):
        Route(start=(0, 0, 0), waypoints=())
    with pytest.raises(SimulatorError, match=r"driving\.speed.*-1"):
        Driving(speed=-1)


def test_perfect_odometry_is_the_truth_seen_from_the_start() -> None:
    truth = _random_walk(200, 0.1, 0.2)
    odometry = measure_odometry(truth, PERFECT, PERIOD, np.random.default_rng(0))
    np.testing.assert_allclose(odometry, se2.between(truth[0], truth), atol=1e-9)


def test_scales_and_drift_act_on_each_step() -> None:
    truth = _random_walk(50, 0.1, 0.2)
    model = replace(PERFECT, translation_scale=1.1, rotation_scale=0.9, heading_drift=0.05)
    reported = _steps(measure_odometry(truth, model, PERIOD, np.random.default_rng(0)))
    true = _steps(truth)
    np.testing.assert_allclose(reported[:, 0], 1.1 * true[:, 0], atol=1e-9)
    np.testing.assert_allclose(reported[:, 2], 0.9 * true[:, 2] + 0.05 * np.hypot(true[:, 0], true[:, 1]), atol=1e-9)


def test_noise_grows_with_the_square_root_of_the_way() -> None:
    n_steps, runs = 100, 400
    truth = np.column_stack([np.linspace(0, 9, n_steps), np.zeros((n_steps, 2))])
    model = replace(PERFECT, translation_std=0.03, drift_std=0.01)
    ends = np.array([_ends(truth, model, seed) for seed in range(runs)])
    assert np.std(ends[:, 0]) == pytest.approx(0.03 * math.sqrt(9), rel=0.12)
    assert np.std(ends[:, 2]) == pytest.approx(0.01 * math.sqrt(9), rel=0.12)
    turning = np.column_stack([np.zeros((n_steps, 2)), np.linspace(0, 2, n_steps)])
    ends = np.array([_ends(turning, replace(PERFECT, rotation_std=0.05), seed) for seed in range(runs)])
    assert np.std(ends[:, 2]) == pytest.approx(0.05 * math.sqrt(2), rel=0.12)


def test_slip_lasts_for_its_time() -> None:
    n_steps = 40_000
    turning = np.column_stack([np.zeros((n_steps, 2)), 0.1 * np.arange(n_steps)])
    model = replace(PERFECT, slip_std=0.02, slip_time=2.0)
    odometry = measure_odometry(turning, model, PERIOD, np.random.default_rng(0))
    slip = _steps(odometry)[:, 2] / 0.1 - 1.0
    assert slip.std() == pytest.approx(0.02, rel=0.1)
    later = round(model.slip_time / PERIOD)
    correlation = float(np.corrcoef(slip[:-later], slip[later:])[0, 1])
    assert correlation == pytest.approx(math.exp(-1), abs=0.06)


def test_a_standing_robot_reports_no_motion() -> None:
    odometry = measure_odometry(np.ones((20, 3)), OdometryModel(), PERIOD, np.random.default_rng(0))
    np.testing.assert_allclose(odometry, 0.0, atol=1e-12)


def _least_clearance(world: World, truth: NDArray[np.float64]) -> float:
    at_times = len(np.unique(np.concatenate([world.visible_from, world.visible_to]))) > 2
    piece = 1 if at_times else 100
    starts = range(0, len(truth), 2 * piece)
    return min(float(world.clearance(truth[i : i + 2 * piece : 2, :2], i * PERIOD).min()) for i in starts)


def _ends(truth: NDArray[np.float64], model: OdometryModel, seed: int) -> NDArray[np.float64]:
    end: NDArray[np.float64] = measure_odometry(truth, model, PERIOD, np.random.default_rng(seed))[-1]
    return end


def _steps(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return se2.between(poses[:-1], poses[1:])


def _random_walk(n: int, speed: float, turn: float) -> NDArray[np.float64]:
    rng = np.random.default_rng(7)
    poses = [np.array([2.0, -1.0, 3.0])]
    for step in rng.uniform((0, -0.01, -turn), (speed, 0.01, turn), size=(n, 3)):
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)
