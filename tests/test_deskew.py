"""Beams moved by the motion within a sweep: closed forms, and what stays as it was."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.scan import Log, ScanGeometry
from frontends.simulator import world as shapes
from frontends.simulator.laser import Course, Laser, sense
from frontends.simulator.scene import load_scene
from frontends.simulator.world import World
from graph.se2 import compose, expmap
from iceg.slam.recording.intervals import usual_interval, waits
from iceg.slam.sweep.deskew import deskewed
from iceg.slam.sweep.motion import MotionWithin, motion_within

ALL_AROUND = ScanGeometry(
    bearings=np.linspace(-np.pi, np.pi, 361)[:-1],
    range_min=0.05,
    range_max=20.0,
    T_robot_laser=np.array([0.1, -0.05, 0.3]),
)
EXACT = Laser(geometry=ALL_AROUND, range_std=0.0, range_std_per_metre=0.0, quantisation=0.0, mixed_share=0.0)
IN_A_ROOM = World.empty().with_segments(shapes.rectangle(0.0, 0.0, 9.0, 6.0, 0.2))


def _swept(pose: NDArray[np.float64], twist: NDArray[np.float64], sweep: float) -> tuple[Log, Log]:
    """What a laser that sweeps sees at a constant velocity (per interval of 0.2 s), and one that does not."""
    course = Course(T_world_robot=compose(pose, expmap(twist * np.linspace(-2.0, 2.0, 5)[:, None])), step=0.2)
    swept = sense(IN_A_ROOM, pose[None], replace(EXACT, sweep_time=0.2 * sweep), RNG(), 0.4, course=course)
    return _log(swept), _log(sense(IN_A_ROOM, pose[None], EXACT, RNG()))


@given(
    x=st.floats(-1.0, 1.0),
    heading=st.floats(-3.0, 3.0),
    forward=st.floats(-0.15, 0.15),
    turn=st.floats(-0.25, 0.25),
    sweep=st.floats(-1.0, 1.0),
)
@settings(max_examples=40)
def test_walls_of_a_moving_robot_are_as_straight_as_of_one_that_stands(
    x: float, heading: float, forward: float, turn: float, sweep: float
) -> None:
    twist = np.array([forward, 0.0, turn])
    bent, straight = _swept(np.array([x, 0.3, heading]), twist, sweep)
    motion = MotionWithin(velocity=twist[None], change=np.zeros((1, 3)))
    error = np.abs(deskewed(bent, motion, sweep).ranges - straight.ranges)[0]
    # Corners lie between two beams, and where the sweep begins and ends a few bearings are seen twice or never.
    assert np.nanquantile(error, 0.85) < 0.003
    assert np.nanmedian(error) <= np.nanmedian(np.abs(bent.ranges - straight.ranges)) + 1e-3


def test_a_wall_seen_while_the_robot_turns_on_the_spot() -> None:
    """In closed form: beam b of bearing β is measured at the turn ωτ, and meets a wall d away at d / cos(β + ωτ).

    The wall's own range at that bearing is the same: what moves is the bearing, and nothing but that.
    """
    bearings = np.radians(np.linspace(-60.0, 60.0, 121))
    geometry = ScanGeometry(bearings=bearings, range_min=0.05, range_max=20.0)
    turn, sweep = 0.2, 0.8
    seen_at = bearings + turn * sweep * np.linspace(-0.5, 0.5, 121)
    log = _log((3.0 / np.cos(seen_at))[None], geometry)
    motion = MotionWithin(velocity=np.array([[0.0, 0.0, turn]]), change=np.zeros((1, 3)))
    straight = deskewed(log, motion, sweep).ranges[0]
    np.testing.assert_allclose(straight[1:-1], (3.0 / np.cos(bearings))[1:-1], rtol=2e-4)


def test_a_robot_that_stands_sees_what_it_saw() -> None:
    log = _log(sense(load_scene("room").world, np.array([[1.0, 1.0, 0.4]]), Laser(geometry=ALL_AROUND), RNG()))
    still = MotionWithin(velocity=np.zeros((1, 3)), change=np.zeros((1, 3)))
    np.testing.assert_allclose(deskewed(log, still, 1.0).ranges, log.ranges, rtol=1e-6)


def test_a_beam_without_return_stays_one_and_lends_nothing_to_its_neighbours() -> None:
    ranges = np.full((1, 360), np.nan)
    ranges[0, 100] = 2.0
    motion = MotionWithin(velocity=np.array([[0.1, 0.0, 0.2]]), change=np.zeros((1, 3)))
    found = deskewed(_log(ranges), motion, 1.0).ranges
    assert np.isfinite(found).sum() in (1, 2)
    assert np.nanmin(found) > 1.8


@given(st.lists(st.floats(0.06, 19.0), min_size=360, max_size=360), st.floats(-0.3, 0.3), st.floats(-1.1, 1.1))
@settings(max_examples=30)
def test_no_range_is_made_up(readings: list[float], turn: float, sweep: float) -> None:
    """Whatever is seen, a range lies between the shortest and the longest measured, give or take the robot's way."""
    motion = MotionWithin(velocity=np.array([[0.05, 0.0, turn]]), change=np.zeros((1, 3)))
    found = deskewed(_log(np.array([readings])), motion, sweep).ranges
    returns = found[np.isfinite(found)]
    assert returns.min() > min(readings) - 0.1
    assert returns.max() < max(readings) + 0.1


def test_the_motion_within_a_scan_is_the_parabola_through_its_neighbours() -> None:
    speeds = 0.1 + 0.02 * np.arange(9)
    poses = np.stack([np.concatenate([[0.0], np.cumsum(speeds)]), np.zeros(10), np.zeros(10)], axis=1)
    motion = motion_within(poses, np.arange(0.0, 1.9, 0.2))
    np.testing.assert_allclose(motion.velocity[1:-1, 0], 0.5 * (speeds[:-1] + speeds[1:]))
    np.testing.assert_allclose(motion.change[1:-1, 0], 0.02)
    assert motion.velocity[0, 0] == pytest.approx(speeds[0])
    assert motion.change[0, 0] == 0.0


def test_an_unknown_step_says_nothing_of_the_motion() -> None:
    poses = np.zeros((6, 3))
    poses[:, 0] = [0.0, 0.1, 0.2, 5.2, 5.3, 5.4]
    motion = motion_within(poses, np.arange(6.0), unknown=[3])
    np.testing.assert_allclose(motion.velocity[:, 0], 0.1)


def test_a_missing_scan_is_no_haste() -> None:
    poses = np.zeros((5, 3))
    poses[:, 0] = [0.0, 0.1, 0.4, 0.5, 0.6]
    stamps = np.array([0.0, 0.2, 0.8, 1.0, 1.2])
    np.testing.assert_allclose(motion_within(poses, stamps).velocity[:, 0], 0.1)
    assert usual_interval(stamps) == pytest.approx(0.2)


def test_stamps_that_stand_still_count_scans() -> None:
    assert usual_interval(np.zeros(5)) is None
    np.testing.assert_array_equal(waits(np.zeros(5)), np.ones(4))


def _log(ranges: NDArray[Any], geometry: ScanGeometry = ALL_AROUND) -> Log:
    return Log(
        ranges=ranges.astype(np.float32),
        odometry=np.zeros((len(ranges), 3)),
        stamps=np.arange(len(ranges), dtype=np.float64),
        geometry=geometry,
        path=Path("swept.clf"),
    )


def RNG() -> np.random.Generator:
    return np.random.default_rng(0)
