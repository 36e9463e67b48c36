"""Many scans followed by one compiled loop, against the same scans tracked one by one."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from frontends.scan import Log
from frontends.simulator.simulation import simulate
from graph.measurement import RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between, compose
from iceg.ice.matcher import IceMatcher
from iceg.slam.config import FrontEndConfig
from iceg.slam.track import Track
from iceg.slam.tracking.front_end import FrontEnd
from iceg.slam.tracking.log_tracking import track_log
from tests.scripted_matcher import ScanByScan


class IceScanByScan(ScanByScan, IceMatcher):
    """ICE without its way to follow many scans at once."""


@pytest.fixture(scope="module")
def office() -> Log:
    """The beginning of a simulated office."""
    return simulate("office", seed=3).log.select(slice(600))


def _covered(log: Log) -> Log:
    ranges = log.ranges.copy()
    ranges[150:170] = 0.1
    ranges[300:310] = np.nan
    return replace(log, ranges=ranges)


def _jumping(log: Log) -> Log:
    steps = between(log.odometry[:-1], log.odometry[1:])
    steps[[60, 200, 330]] += ((1.5, 0.0, 0.3), (0.25, 0.1, 0.0), (0.0, 0.0, 0.5))
    odometry = [log.odometry[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    return replace(log, odometry=np.array(odometry))


def _standing(log: Log) -> Log:
    odometry = log.odometry.copy()
    odometry[200:320] = odometry[200]
    return replace(log, odometry=odometry)


def _as_it_is(log: Log) -> Log:
    return log


def _without_odometry(log: Log) -> Log:
    return replace(log, has_odometry=False)


@pytest.mark.parametrize("disturbed", [_as_it_is, _covered, _jumping, _standing, _without_odometry])
def test_scans_followed_together_end_where_those_tracked_one_by_one_do(disturbed: Any, office: Log) -> None:
    log = disturbed(office)
    noise = OdometryModel(along_per_metre=0.1, heading_per_radian=0.05)
    together = track_log(log, IceMatcher(), noise, FrontEndConfig())
    one_by_one = track_log(log, IceScanByScan(), noise, FrontEndConfig())
    _assert_same(together, one_by_one)


def _assert_same(track: Track, expected: Track) -> None:
    np.testing.assert_array_equal(track.key_of_scan, expected.key_of_scan)
    np.testing.assert_array_equal(track.T_key_scan, expected.T_key_scan)
    assert (track.failures, track.lost, track.breaks) == (expected.failures, expected.lost, expected.breaks)
    for key, same in zip(track.keys, expected.keys, strict=True):
        assert key.index == same.index
        np.testing.assert_array_equal(key.T_track_robot, same.T_track_robot)
        np.testing.assert_array_equal(key.motion.covariance, same.motion.covariance)
        assert (key.motion.distance, key.motion.turn) == (same.motion.distance, same.motion.turn)
        assert type(key.match) is type(same.match)
        if isinstance(key.match, RelativePose) and isinstance(same.match, RelativePose):
            np.testing.assert_array_equal(key.match.covariance, same.match.covariance)


def test_following_stops_at_each_key_scan_and_before_a_scan_that_is_no_plain_match(office: Log) -> None:
    log = _covered(office)
    front_end = FrontEnd(IceMatcher(), OdometryModel(), FrontEndConfig())
    steps = np.vstack([np.zeros(3), between(log.odometry[:-1], log.odometry[1:])])
    front_end.add(0, log.scan(0), None)
    index, ends = 1, []
    while index < 150:
        before = len(front_end.keys)
        poses = front_end.follow(index, log.ranges[index:], steps[index:], log.geometry)
        if len(poses) == 0:
            front_end.add(index, log.scan(index), steps[index])
            index += 1
            continue
        index += len(poses)
        ends.append(index)
        if len(front_end.keys) > before:
            assert front_end.keys[-1].index == index - 1
            np.testing.assert_array_equal(front_end.keys[-1].T_track_robot, poses[-1])
    assert index == 150
    assert len(front_end.keys) > 10
    assert not len(front_end.follow(150, log.ranges[150:], steps[150:], log.geometry))


def test_a_matcher_without_refinement_is_not_followed(office: Log) -> None:
    ice = IceMatcher()
    ice = IceMatcher(replace(ice.config, refinement=replace(ice.config.refinement, enabled=False)))
    front_end = FrontEnd(ice, OdometryModel(), FrontEndConfig())
    front_end.add(0, office.scan(0), None)
    steps = between(office.odometry[:-1], office.odometry[1:])
    assert not len(front_end.follow(1, office.ranges[1:], steps, office.geometry))
