"""Random scenes: every kind can be driven, and a seed says all."""

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from frontends.logs import read_log
from frontends.simulator.random_scenes.devices import DEVICES, random_laser, random_odometry
from frontends.simulator.random_scenes.ground import survey
from frontends.simulator.random_scenes.plans import PLANS, WIDE, Kind
from frontends.simulator.random_scenes.scene import KINDS, RandomScene, named_seed, random_scene, simulate_random
from frontends.simulator.world import SimulatorError, World, rectangle
from iceg.cli import main

LENGTH = 25.0


@cache
def drawn(seed: int, kind: Kind) -> RandomScene:
    return random_scene(seed, kind, length=LENGTH)


def places(scene: RandomScene) -> np.ndarray:
    """(n, 2) start and waypoints."""
    route = scene.scene.route
    return np.array([route.start[:2], *((w.x, w.y) for w in route.waypoints)])


@pytest.mark.parametrize("kind", KINDS)
def test_the_route_keeps_clear_of_walls_and_starts_at_the_identity(kind: Kind) -> None:
    scene = drawn(1, kind)
    assert scene.scene.route.start == (0.0, 0.0, 0.0)
    points = places(scene)
    assert scene.scene.world.clearance(points).min() > 0.3
    between = np.concatenate([a + np.linspace(0.0, 1.0, 20)[:, None] * (b - a) for a, b in pairwise(points)])
    assert scene.scene.world.clearance(between).min() > 0.2
    travelled = np.hypot(*np.diff(points, axis=0).T).sum()
    assert travelled > 0.6 * LENGTH


@pytest.mark.parametrize("kind", KINDS)
def test_the_first_waypoint_lies_straight_ahead(kind: Kind) -> None:
    first = drawn(1, kind).scene.route.waypoints[0]
    assert first.x > 0
    assert first.y == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("kind", ["house", "round"])
def test_the_same_seed_draws_the_same_scene(kind: Kind) -> None:
    first, second = drawn(1, kind), random_scene(1, kind, length=LENGTH)
    assert np.array_equal(first.scene.world.segments, second.scene.world.segments)
    assert first.scene.route == second.scene.route
    assert first.scene.people == second.scene.people
    assert first.scene.odometry == second.scene.odometry
    assert (first.scene.name, first.driving) == (second.scene.name, second.driving)


def test_different_seeds_draw_different_scenes() -> None:
    scenes = [drawn(seed, "house") for seed in range(4)]
    assert len({scene.scene.world.segments.tobytes() for scene in scenes}) == 4
    assert len({scene.scene.route for scene in scenes}) == 4
    assert len({scene.driving for scene in scenes}) == 4


def test_seeds_take_the_kinds_in_turn() -> None:
    assert tuple(PLANS) == KINDS
    assert random_scene(2, length=LENGTH).kind == KINDS[2]
    with pytest.raises(SimulatorError, match="seed of 0 or more"):
        random_scene(-1)


def test_a_house_is_driven_and_recorded() -> None:
    simulation = simulate_random(3, "house", length=8.0)
    assert simulation.truth[0] == pytest.approx([0.0, 0.0, 0.0])
    assert len(simulation.log.ranges) == len(simulation.truth) > 20
    assert np.isfinite(simulation.log.ranges).any(axis=1).all()


def test_a_robot_without_odometry_reports_none() -> None:
    seed = next(seed for seed in range(50) if not drawn(seed, "house").has_odometry)
    log = simulate_random(seed, "house", length=5.0).log
    assert not log.has_odometry
    assert not log.odometry.any()


def test_wide_places_get_lasers_that_see_something() -> None:
    rng = np.random.default_rng(0)
    assert {random_laser(rng)[0] for _ in range(100)} == set(DEVICES)
    assert all(random_laser(rng, 8.0)[1].geometry.range_max >= 8.0 for _ in range(50))
    assert all(drawn(1, kind).scene.laser.geometry.range_max >= 8.0 for kind in WIDE)


def test_wheels_of_every_quality_are_drawn() -> None:
    rng = np.random.default_rng(0)
    assert {random_odometry(rng)[0] for _ in range(50)} == {"good", "fair", "poor", "none"}


def test_ground_is_the_inside_of_a_room_and_not_of_its_furniture() -> None:
    world = World.empty().with_segments(rectangle(0.0, 0.0, 6.0, 4.0)).with_segments(rectangle(1.0, 0.0, 1.5, 1.5))
    ground = survey(world.segments)
    free = ground.centres(np.argwhere(ground.is_free))
    assert world.clearance(free).min() > 0.3
    assert np.abs(free).max(axis=0) == pytest.approx([2.6, 1.6], abs=0.11)
    assert not (np.abs(free - [1.0, 0.0]) < 0.75).all(axis=1).any()
    assert ground.is_free_between(np.array([-2.0, 0.0]), np.array([-1.0, 0.5]))
    assert not ground.is_free_between(np.array([-1.0, 0.0]), np.array([2.3, 0.0]))


def test_other_drives_through_a_scene_have_other_noise() -> None:
    first, other = (simulate_random(3, "house", length=5.0, drive=drive) for drive in (0, 1))
    assert np.array_equal(first.scene.world.segments, other.scene.world.segments)
    assert not np.array_equal(first.truth, other.truth)


def test_a_name_gives_the_seed() -> None:
    assert named_seed("random:12") == 12
    assert named_seed("rooms") is named_seed("random.world") is None
    for name in ("random", "random:", "random:x", "random:-1", "random:1.5", "random:²"):
        with pytest.raises(SimulatorError, match="expected random:SEED"):
            named_seed(name)


def test_the_command_simulates_a_random_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "random:19", "-o", str(tmp_path / "out"), "--laser", "sick"]) == 0
    assert "random-19-maze" in capsys.readouterr().out
    assert read_log(tmp_path / "out" / "log.clf").geometry.n_beams == 181
    assert main(["simulate", "random:x", "-o", str(tmp_path / "other")]) == 1
    assert "expected random:SEED" in capsys.readouterr().err
