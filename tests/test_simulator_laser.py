"""Ray casting against a slow twin, and what the device adds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.simulator import world as shapes
from frontends.simulator.laser import Laser, cast, sense, sick_lms200
from frontends.simulator.scene import load_scene
from frontends.simulator.world import SimulatorError, World

EXACT = Laser(range_std=0.0, range_std_per_metre=0.0, quantisation=0.0, mixed_share=0.0)
AT_ORIGIN = np.zeros((1, 3))


def test_a_square_room_from_its_middle() -> None:
    world = World.empty().with_segments(shapes.rectangle(0, 0, 6, 6))
    bearings = np.radians([-90.0, -45.0, 0.0, 30.0, 90.0])
    expected = [3, 3 * np.sqrt(2), 3, 3 / np.cos(np.radians(30)), 3]
    np.testing.assert_allclose(cast(world, AT_ORIGIN, bearings, 20.0)[0], expected)


def test_a_turned_laser_sees_the_same_room_turned() -> None:
    world = World.empty().with_segments(shapes.rectangle(1, 0, 6, 4))
    bearings = np.radians([0.0, 90.0])
    ranges = cast(world, [(0, 0, 0), (0, 0, np.pi / 2), (0, 0, np.pi)], bearings, 20.0)
    np.testing.assert_allclose(ranges, [(4, 2), (2, 2), (2, 2)])


def test_nothing_within_reach_is_inf_and_behind_is_not_seen() -> None:
    world = World.empty().with_segments(shapes.polyline([(5, -1), (5, 1)]))
    assert np.isinf(cast(world, AT_ORIGIN, np.array([0.0]), 4.9)).all()
    assert np.isinf(cast(world, AT_ORIGIN, np.array([np.pi]), 20.0)).all()
    assert cast(world, AT_ORIGIN, np.array([0.0]), 5.0)[0, 0] == 5.0


def test_a_wall_seen_edge_on_does_not_hide_what_stands_behind() -> None:
    world = World.empty().with_segments(shapes.polyline([(1, 0), (2, 0)]))
    world = world.with_segments(shapes.polyline([(3, -1), (3, 1)]))
    assert cast(world, AT_ORIGIN, np.array([0.0]), 20.0)[0, 0] == 3.0


def test_walls_that_share_an_end_leave_no_gap() -> None:
    world = World.empty().with_segments(shapes.polyline([(3, -2), (2, 0), (3, 2)]))
    assert cast(world, AT_ORIGIN, np.array([0.0]), 20.0)[0, 0] == pytest.approx(2.0)


def test_each_scan_sees_the_world_of_its_time() -> None:
    world = World.empty().with_segments(shapes.polyline([(5, -1), (5, 1)]))
    world = world.with_segments(shapes.polyline([(2, -1), (2, 1)]), start=1.0, end=3.0)
    ranges = cast(world, np.zeros((4, 3)), np.array([0.0]), 20.0, [0.0, 1.0, 2.9, 3.0])
    np.testing.assert_array_equal(ranges[:, 0], [5, 2, 2, 5])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_casting_agrees_with_the_slow_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = World.empty().with_segments(rng.uniform(-8, 8, size=(6, 4)))
    pose = rng.uniform((-8, -8, -np.pi), (8, 8, np.pi))
    bearings = np.linspace(-np.pi, np.pi, 41)
    np.testing.assert_allclose(
        cast(world, pose, bearings, 10.0)[0], _cast_slowly(world.segments, pose, bearings, 10.0), rtol=1e-9
    )


def test_points_of_an_exact_scan_lie_on_the_walls() -> None:
    world = load_scene("room").world
    poses = np.array([(0.0, 0.0, 0.3), (4.0, 2.5, -2.0)])
    ranges = sense(world, poses, EXACT, np.random.default_rng(0))
    for pose, scan in zip(poses, ranges, strict=True):
        assert world.clearance(_points_in_world(pose, scan, EXACT)).max() < 1e-5


def test_noise_has_the_stated_spread_and_quantisation_the_stated_step() -> None:
    world = World.empty().with_segments(shapes.polyline([(10, -50), (10, 50)]))
    laser = Laser(geometry=replace(sick_lms200(), bearings=np.zeros(1), T_robot_laser=np.zeros(3)), quantisation=0.0)
    ranges = sense(world, np.zeros((20_000, 3)), laser, np.random.default_rng(1))
    assert ranges.mean() == pytest.approx(10.0, abs=5e-4)
    assert ranges.std() == pytest.approx(0.005 + 10 * 0.0005, rel=0.03)
    steps = sense(world, np.zeros((100, 3)), replace(laser, quantisation=0.01), np.random.default_rng(1)) * 100
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)


def test_no_return_is_nan_from_the_maximum_range_on() -> None:
    world = World.empty().with_segments(shapes.polyline([(19.999, -1), (19.999, 1)]))
    laser = Laser(geometry=replace(sick_lms200(), bearings=np.array([-1.0, 0.0]), T_robot_laser=np.zeros(3)))
    ranges = sense(world, np.zeros((200, 3)), laser, np.random.default_rng(0))
    assert np.isnan(ranges[:, 0]).all()
    assert 0 < np.isnan(ranges[:, 1]).sum() < 200
    assert np.nanmax(ranges) < 20.0


def test_mixed_pixels_lie_between_both_sides_of_an_edge_and_nowhere_else() -> None:
    world = (
        World.empty()
        .with_segments(shapes.polyline([(2, -50), (2, 0)]))
        .with_segments(shapes.polyline([(6, -50), (6, 50)]))
    )
    laser = replace(EXACT, mixed_share=0.5, geometry=replace(EXACT.geometry, T_robot_laser=np.zeros(3)))
    poses = np.zeros((400, 3))
    mixed, exact = sense(world, poses, laser, np.random.default_rng(3)), sense(world, poses, EXACT_THERE, RNG())
    differs = np.abs(mixed - exact) > 1e-6
    edge = int(np.argmin(np.abs(laser.geometry.bearings)))
    assert set(np.flatnonzero(differs.any(axis=0))) == {edge}
    assert differs[:, edge].mean() == pytest.approx(0.5, abs=0.1)
    assert ((mixed[:, edge] >= 2 - 1e-3) & (mixed[:, edge] <= 6 + 1e-3)).all()


@pytest.mark.parametrize("setting", [{"mixed_share": 1.5}, {"range_std": -0.1}, {"quantisation": -1.0}])
def test_settings_out_of_range_are_refused(setting: dict[str, float]) -> None:
    with pytest.raises(SimulatorError, match=next(iter(setting))):
        Laser(**setting)  # type: ignore[arg-type]


EXACT_THERE = replace(EXACT, geometry=replace(EXACT.geometry, T_robot_laser=np.zeros(3)))


def RNG() -> np.random.Generator:
    return np.random.default_rng(0)


def _cast_slowly(
    segments: NDArray[np.float64], pose: NDArray[np.float64], bearings: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """Solve origin + r·u = a + s·(b − a) beam by beam, segment by segment."""
    ranges = np.full(len(bearings), np.inf)
    for k, bearing in enumerate(bearings + pose[2]):
        u = np.array([np.cos(bearing), np.sin(bearing)])
        for a, b in segments.reshape(-1, 2, 2):
            r, s = np.linalg.solve(np.column_stack([u, a - b]), a - pose[:2])
            if 0 < r <= reach and 0 <= s <= 1:
                ranges[k] = min(ranges[k], r)
    return ranges


def _points_in_world(pose: NDArray[np.float64], scan: NDArray[np.float32], laser: Laser) -> NDArray[np.float64]:
    p = laser.geometry.origin_robot + scan[:, None] * laser.geometry.directions_robot
    c, s = np.cos(pose[2]), np.sin(pose[2])
    placed: NDArray[np.float64] = p @ np.array([(c, s), (-s, c)]) + pose[:2]
    return placed[np.isfinite(scan)]
