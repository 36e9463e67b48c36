"""Ray casting against a slow twin, and what the device adds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.simulator import world as shapes
from frontends.simulator.laser import Course, Laser, cast, sense, sick_lms200
from frontends.simulator.scene import load_scene
from frontends.simulator.world import SimulatorError, World
from graph import se2

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
    geometry = replace(sick_lms200(), bearings=np.array([0.0, 1e-6]), T_robot_laser=np.zeros(3))
    laser = Laser(geometry=geometry, quantisation=0.0)
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


def test_glass_lets_slanting_beams_pass_and_mirrors_what_meets_it_squarely() -> None:
    pane, wall = shapes.polyline([(2, -50), (2, 50)]), shapes.polyline([(5, -50), (5, 50)])
    world = World.empty().with_segments(pane, glass=1.0).with_segments(wall)
    ranges = sense(world, AT_ORIGIN, EXACT_THERE, RNG())[0]
    bearings = EXACT_THERE.geometry.bearings
    ahead = np.abs(bearings) < np.radians(75)
    square = ahead & (np.abs(bearings) < np.radians(7.9))
    np.testing.assert_allclose(ranges[square], 2 / np.cos(bearings[square]), rtol=1e-6)
    passed = ahead & (np.abs(bearings) > np.radians(8.1))
    np.testing.assert_allclose(ranges[passed], 5 / np.cos(bearings[passed]), rtol=1e-6)


def test_glass_passes_its_share_of_the_beams_and_none_reads_between_for_it() -> None:
    pane, wall = shapes.polyline([(2, -50), (2, 50)]), shapes.polyline([(5, -50), (5, 50)])
    world = World.empty().with_segments(wall).with_segments(pane, glass=0.7)
    poses = np.zeros((200, 3))
    mixing = replace(EXACT_THERE, mixed_share=1.0)
    ranges = sense(world, poses, mixing, RNG())
    slanting = np.abs(np.abs(mixing.geometry.bearings) - np.radians(35)) < np.radians(25)
    across = ranges[:, slanting] * np.cos(mixing.geometry.bearings[slanting])
    on_glass, on_wall = np.abs(across - 2) < 1e-4, np.abs(across - 5) < 1e-4
    assert (on_glass | on_wall).all()
    assert on_wall.mean() == pytest.approx(0.7, abs=0.02)


def test_dark_walls_swallow_their_share_of_the_beams() -> None:
    world = World.empty().with_segments(shapes.polyline([(3, -2), (3, 0)]), dark=0.4)
    world = world.with_segments(shapes.polyline([(3, 0), (3, 2)]))
    ranges = sense(world, np.zeros((300, 3)), EXACT_THERE, RNG())
    bearings = np.degrees(EXACT_THERE.geometry.bearings)
    dark, bright = (bearings > -30) & (bearings < -1), (bearings > 1) & (bearings < 30)
    assert np.isnan(ranges[:, dark]).mean() == pytest.approx(0.4, abs=0.02)
    assert not np.isnan(ranges[:, bright]).any()


def test_a_world_without_glass_or_people_reads_as_if_there_were_no_such_thing() -> None:
    world = load_scene("room").world
    bare = replace(world, glass=np.zeros(len(world.segments)), dark=None)
    poses = np.array([(0.0, 0, 0), (2, 0.3, 1)])
    exact = replace(EXACT, mixed_share=0.0)
    np.testing.assert_array_equal(sense(world, poses, exact, RNG()), sense(bare, poses, exact, RNG()))


@given(
    pose=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-4, 4)),
    twist=st.tuples(st.floats(-2, 2), st.floats(-0.5, 0.5), st.floats(-3, 3)),
    sweep_time=st.sampled_from([0.1, -0.1]),
)
@settings(max_examples=20)
def test_a_sweep_while_moving_against_a_slow_twin(
    pose: tuple[float, float, float], twist: tuple[float, float, float], sweep_time: float
) -> None:
    world = load_scene("room").world
    laser = replace(EXACT, sweep_time=sweep_time)
    poses, twists = np.array([pose]), np.array([twist])
    ranges = sense(world, poses, laser, RNG(), times=1.0, course=_steadily(poses[0], twists[0]))[0].astype(float)
    delays = np.linspace(-0.5, 0.5, laser.geometry.n_beams) * laser.sweep_time
    for k in range(0, laser.geometry.n_beams, 11):
        T_world_laser = se2.compose(se2.compose(poses[0], se2.expmap(twists[0] * delays[k])), [0.16, 0, 0])
        slow = _cast_slowly(world.segments, T_world_laser, laser.geometry.bearings[k : k + 1], 20.0)[0]
        if np.isfinite(slow) and 0.05 <= slow < 20.0:
            assert ranges[k] == pytest.approx(slow, abs=1e-5)
        else:
            assert np.isnan(ranges[k])


def test_a_sweep_sees_a_wall_bent_while_the_robot_turns() -> None:
    world = World.empty().with_segments(shapes.polyline([(4, -30), (4, 30)]))
    laser = replace(EXACT_THERE, sweep_time=0.1)
    turning = sense(world, AT_ORIGIN, laser, RNG(), 1.0, course=_steadily(AT_ORIGIN[0], np.array([0.0, 0.0, 1.0])))[0]
    still = sense(world, AT_ORIGIN, laser, RNG(), 1.0, course=_steadily(AT_ORIGIN[0], np.zeros(3)))[0]
    assert turning[90] == pytest.approx(still[90])
    assert turning[150] > still[150] + 0.1
    assert turning[30] > still[30] + 0.1
    np.testing.assert_allclose(sense(world, AT_ORIGIN, EXACT_THERE, RNG())[0], still, atol=1e-6)


def test_a_robot_stands_before_and_after_its_course() -> None:
    poses = np.array([se2.expmap(np.array([0.1, 0.0, 0.05]) * k) for k in range(10)])
    course = Course(T_world_robot=poses, step=0.2)
    np.testing.assert_allclose(course.at(np.array([-1.0, 0.0, 1.8, 5.0])), poses[[0, 0, 9, 9]], atol=1e-12)
    between = course.at(np.array([[0.1], [0.7]]))
    np.testing.assert_allclose(between[:, 0], se2.expmap(np.array([[0.05, 0, 0.025], [0.35, 0, 0.175]])), atol=1e-12)


def _steadily(pose: NDArray[np.float64], twist: NDArray[np.float64]) -> Course:
    """A drive of constant velocity that is at `pose` after a second."""
    return Course(T_world_robot=se2.compose(pose, se2.expmap(twist * np.linspace(-1.0, 1.0, 5)[:, None])), step=0.5)


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
            lines = np.column_stack([u, a - b])
            if abs(np.linalg.det(lines)) < 1e-12:
                continue
            r, s = np.linalg.solve(lines, a - pose[:2])
            if 0 < r <= reach and 0 <= s <= 1:
                ranges[k] = min(ranges[k], r)
    return ranges


def _points_in_world(pose: NDArray[np.float64], scan: NDArray[np.float32], laser: Laser) -> NDArray[np.float64]:
    p = laser.geometry.origin_robot + scan[:, None] * laser.geometry.directions_robot
    c, s = np.cos(pose[2]), np.sin(pose[2])
    placed: NDArray[np.float64] = p @ np.array([(c, s), (-s, c)]) + pose[:2]
    return placed[np.isfinite(scan)]
