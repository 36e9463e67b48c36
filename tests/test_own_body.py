"""Returns of the robot itself are found and left out, and nothing else is taken for them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import iceg
from frontends.logs import read_log
from frontends.scan import ScanGeometry
from iceg.demo import demo_log_path
from iceg.evaluation.degradation import DEGRADATIONS
from iceg.slam.own_body_config import OwnBodyConfig
from iceg.slam.recording.own_body import intervals_in_hands, own_body, without_own_body

_LOG = read_log(demo_log_path())


def test_a_recording_that_does_not_see_the_robot_stays_as_it_is() -> None:
    assert without_own_body(_LOG, OwnBodyConfig()) is _LOG
    assert not own_body(_LOG.ranges[:0], _LOG.geometry, OwnBodyConfig()).any()
    assert not own_body(np.full_like(_LOG.ranges, np.nan), _LOG.geometry, OwnBodyConfig()).any()


@settings(max_examples=30, deadline=None)
@given(
    first=st.integers(0, 160),
    width=st.integers(2, 20),
    reach=st.floats(0.2, 0.5),
    noise=st.floats(0.0, 0.012),
    shown=st.floats(0.5, 1.0),
)
def test_a_post_is_found_wherever_it_stands(first: int, width: int, reach: float, noise: float, shown: float) -> None:
    rng = np.random.default_rng(first)
    ranges, beams = _LOG.ranges.copy(), np.arange(first, first + width)
    hit = rng.random((len(ranges), width)) < shown
    post = (reach + rng.normal(0.0, noise, hit.shape)).astype(np.float32)
    ranges[:, beams] = np.where(hit, np.fmin(post, ranges[:, beams]), ranges[:, beams])
    posted = replace(_LOG, ranges=ranges)
    assert own_body(ranges, _LOG.geometry, OwnBodyConfig())[beams].all()
    left = without_own_body(posted, OwnBodyConfig())
    assert "the robot itself is in the view of its laser" in left.warnings[-1]
    assert not (np.isfinite(left.ranges[:, beams]) & hit).any()
    far = ~hit & np.isfinite(ranges[:, beams]) & (ranges[:, beams] > reach + 0.2)
    assert np.isfinite(left.ranges[:, beams])[far].all()
    away = np.setdiff1d(np.arange(_LOG.geometry.n_beams), np.arange(first - 2, first + width + 2))
    np.testing.assert_array_equal(left.ranges[:, away], ranges[:, away])


def _corridor(boxes: bool) -> tuple[NDArray[np.float32], ScanGeometry]:
    """A drive straight along a corridor of 1.2 m, 30 m long, with boxes on one side or bare."""
    geometry = ScanGeometry(bearings=np.linspace(-np.pi, np.pi, 361)[:-1], range_min=0.05, range_max=30.0)
    rng, c, s = np.random.default_rng(5), np.cos(geometry.bearings), np.sin(geometry.bearings)
    scans = []
    for x in np.arange(0.0, 25.0, 0.05):
        with np.errstate(divide="ignore"):
            side = 0.6 / np.abs(s)
            end = np.where(c > 0.0, (28.0 - x) / c, (x + 2.0) / -c)
        ranges = np.minimum(side, end)
        if boxes:  # 30 cm deep, every other metre, on the left
            hit = x + 0.3 * c / np.maximum(s, 1e-9)
            ranges = np.where(
                (s > 0.0) & (np.floor(hit) % 2 == 0), np.minimum(ranges, 0.3 / np.maximum(s, 1e-9)), ranges
            )
        scans.append(ranges + rng.normal(0.0, 0.005, ranges.shape))
    return np.array(scans, dtype=np.float32), geometry


@pytest.mark.parametrize("boxes", [False, True])
def test_the_walls_of_a_corridor_that_is_driven_straight_are_no_part_of_the_robot(boxes: bool) -> None:
    ranges, geometry = _corridor(boxes)
    assert not own_body(ranges, geometry, OwnBodyConfig()).any()


def test_a_robot_that_stands_sees_the_box_beside_it() -> None:
    scan = np.where(np.isfinite(_LOG.ranges[0]), _LOG.ranges[0], 5.0)
    scan[50:60] = 0.5
    noise = np.random.default_rng(2).normal(0.0, 0.005, (500, len(scan)))
    standing = (scan + noise).astype(np.float32)
    standing[::3, 40:50] = 2.0  # people pass behind it
    assert not own_body(standing, _LOG.geometry, OwnBodyConfig()).any()


def test_hands_around_the_laser_are_told() -> None:
    held = DEGRADATIONS["hands"](_LOG).log
    left = without_own_body(held, OwnBodyConfig())
    assert f"somebody holds the robot from scan {len(_LOG) // 2} to scan" in left.warnings[-1]
    assert not (left.ranges < 0.15).any()
    off = OwnBodyConfig(nearest=0.0, reach=0.0)
    assert without_own_body(held, off) is held


@pytest.mark.parametrize("fault", ["posts", "cover"])
def test_what_is_left_is_what_the_robot_does_not_hide(fault: str) -> None:
    seen = DEGRADATIONS[fault](_LOG).log.ranges
    left = without_own_body(replace(_LOG, ranges=seen), OwnBodyConfig()).ranges
    np.testing.assert_array_equal(left, np.where(seen == _LOG.ranges, seen, np.float32(np.nan)))


def test_a_run_leaves_the_robot_out() -> None:
    part = DEGRADATIONS["posts"](_LOG.select(np.arange(400))).log
    result = iceg.run(part)
    assert any("the robot itself" in warning for warning in result.log.warnings)
    points = np.isfinite(result.log.ranges) & (result.log.ranges < 0.3)
    assert not points.any()


def test_a_corridor_is_straight_though_the_robot_was_picked_up_in_it(data_dir: Path) -> None:
    log = read_log(data_dir / "bags" / "urg-corridor-2019-04.bag")
    heading = np.unwrap(iceg.run(log).trajectory[:, 2])
    assert abs(heading[600] - heading[200]) < 0.15


def test_a_mapper_leaves_out_the_robot_once_it_has_seen_different_places() -> None:
    posted = DEGRADATIONS["posts"](_LOG.select(np.arange(500))).log
    free = without_own_body(posted, OwnBodyConfig())
    mappers = iceg.Mapper(_LOG.geometry), iceg.Mapper(_LOG.geometry)
    for index in range(len(posted)):
        newest = [
            mapper.add(log.ranges[index], log.odometry[index], log.stamps[index])
            for mapper, log in zip(mappers, (posted, free), strict=True)
        ]
    np.testing.assert_array_equal(newest[0].pose, newest[1].pose)
    np.testing.assert_array_equal(mappers[0].result().log.ranges, free.ranges)
    np.testing.assert_array_equal(mappers[0].finish().trajectory, mappers[1].finish().trajectory)


def test_whoever_holds_the_robot_and_walks_off_is_told_from_a_cloth_and_a_dock() -> None:
    held = DEGRADATIONS["hands"](_LOG).log
    (first, last) = intervals_in_hands(held.ranges, OwnBodyConfig())[0]
    hidden = np.flatnonzero((held.ranges < 0.15).any(axis=1))
    assert (first, last) == (hidden[0], hidden[-1])
    assert intervals_in_hands(DEGRADATIONS["covered"](_LOG).log.ranges, OwnBodyConfig()) == []
    docked = np.repeat(held.ranges[first : first + 1], 500, axis=0)
    assert intervals_in_hands(docked, OwnBodyConfig()) == []
