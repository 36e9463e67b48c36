"""Scans that come again to the last bit: a frozen laser, lines written twice, and robots that stand."""

from dataclasses import replace

import numpy as np
import pytest

from frontends.logs import read_log
from frontends.scan import Log
from graph.odometry import OdometryModel
from iceg.demo import demo_log_path
from iceg.ice.matcher import IceMatcher
from iceg.slam.config import FrontEndConfig
from iceg.slam.recording.held_readings import with_odometry_between_readings
from iceg.slam.recording.repeated_scans import frozen_intervals, is_repeated, without_frozen_scans
from iceg.slam.tracking.front_end import COVERED
from iceg.slam.tracking.log_tracking import track_log
from iceg.slam.tracking_config import StandstillConfig


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(demo_log_path())


def _frozen(log: Log, first: int, last: int) -> Log:
    ranges = log.ranges.copy()
    ranges[first : last + 1] = ranges[first - 1]
    return replace(log, ranges=ranges)


def test_no_two_scans_of_a_laser_are_the_same_bit_by_bit(log: Log) -> None:
    assert not is_repeated(log.ranges).any()
    assert without_frozen_scans(log) is log
    assert not len(is_repeated(log.ranges[:0]))


def test_a_laser_that_freezes_while_the_robot_drives_sees_nothing(log: Log) -> None:
    frozen = _frozen(_frozen(log, 500, 540), 800, 800)
    assert frozen_intervals(frozen) == [(500, 540), (800, 800)]
    believed = without_frozen_scans(frozen)
    np.testing.assert_array_equal(believed.ranges[:500], log.ranges[:500])
    assert np.isnan(believed.ranges[500:541]).all()
    assert np.isfinite(believed.ranges[541]).any()
    assert "42 scans while the odometry moves, first from scan 500 to scan 540" in believed.warnings[-1]


def test_a_robot_that_stands_and_a_laser_that_sees_nothing_are_not_frozen(log: Log) -> None:
    standing = replace(_frozen(log, 500, 540), odometry=log.odometry.copy())
    standing.odometry[499:541] = standing.odometry[499]
    assert not frozen_intervals(standing)
    nothing = replace(log, ranges=np.full_like(log.ranges, np.nan))
    assert not frozen_intervals(nothing)
    assert not frozen_intervals(replace(_frozen(log, 500, 540), has_odometry=False))


def test_lines_written_twice_are_neither_a_frozen_laser_nor_a_slow_odometry(log: Log) -> None:
    twice = np.repeat(np.arange(len(log)), 2)
    doubled = replace(log, ranges=log.ranges[twice], odometry=log.odometry[twice], stamps=log.stamps[twice])
    assert without_frozen_scans(doubled) is doubled
    assert with_odometry_between_readings(doubled, StandstillConfig()) is doubled


def test_key_scans_wait_for_a_scan_that_sees_where_odometry_tells_the_way(log: Log) -> None:
    """A laser that is read anew at every seventh scan only, after half a metre: no key scan is one of the others."""
    stuck = without_frozen_scans(replace(log, ranges=log.ranges[np.arange(len(log)) // 7 * 7]))
    matcher, config = IceMatcher(), FrontEndConfig()
    track = track_log(stuck, matcher, OdometryModel(), config)
    blind = [key for key in track.keys if key.match == COVERED]
    assert len(track.keys) > 40
    assert len(blind) < 0.05 * len(track.keys)
    spaced = replace(config, key_scans=replace(config.key_scans, blind_spacing=1.0))
    before = track_log(stuck, matcher, OdometryModel(), spaced)
    assert sum(key.match == COVERED for key in before.keys) > 0.3 * len(before.keys)
