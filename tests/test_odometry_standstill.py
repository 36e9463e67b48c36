"""Odometry that stands still while the robot moves, and robots that truly stand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from graph.odometry import OdometryModel
from iceg.demo import demo_log_path
from iceg.ice.matcher import IceMatcher
from iceg.slam.config import FrontEndConfig
from iceg.slam.recording.held_readings import between_readings, held_readings, with_odometry_between_readings
from iceg.slam.recording.intervals import waits
from iceg.slam.recording.standstill import dead_intervals
from iceg.slam.tracking.log_tracking import track_log
from iceg.slam.tracking_config import StandstillConfig


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(demo_log_path())


def _straight(n: int) -> NDArray[np.float64]:
    return np.column_stack([0.1 * np.arange(n), np.zeros(n), np.zeros(n)])


def _held(odometry: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    return odometry[np.arange(len(odometry)) // n * n]


def _filled(odometry: NDArray[np.float64], stamps: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    periods = waits(np.arange(len(odometry)) / 5.0 if stamps is None else stamps)
    return between_readings(odometry, periods, *held_readings(odometry, periods, StandstillConfig()))


@pytest.mark.parametrize("n", [2, 3, 5, 20])
def test_a_reading_for_several_scans_is_noticed_and_the_move_spread_over_them(n: int) -> None:
    truth = _straight(60 * n + 1)
    inner = slice(n, -n)
    np.testing.assert_allclose(_filled(_held(truth, n))[inner], truth[inner], atol=1e-12)


def test_in_a_bend_the_readings_stay_and_the_rest_lies_near(log: Log) -> None:
    seldom = _held(log.odometry, 3)
    spread = _filled(seldom, log.stamps)
    assert np.mean(spread[::3] == log.odometry[::3]) > 0.98  # a robot may start a little before a reading
    before, after = (np.abs(odometry - log.odometry)[:-3, :2] for odometry in (seldom, spread))
    assert after.mean() < 0.1 * before.mean()
    assert after.max() < 0.5 * before.max()


def test_a_stop_is_no_held_reading_and_ends_where_the_next_reading_explains_it() -> None:
    truth = np.concatenate([_straight(100), np.tile(_straight(100)[-1], (50, 1)), _straight(200)[100:]])
    np.testing.assert_array_equal(_filled(truth), truth)
    spread = _filled(_held(truth, 5))
    np.testing.assert_allclose(spread[100:145, 0], truth[100:145, 0], atol=1e-9)


def test_a_stall_for_a_second_is_bridged_and_nothing_else_is_touched(log: Log) -> None:
    stalled = log.odometry.copy()
    stalled[401:405] = stalled[400]
    filled = _filled(stalled, log.stamps)
    others = np.setdiff1d(np.arange(len(log)), np.arange(401, 405))
    np.testing.assert_array_equal(filled[others], log.odometry[others])
    assert np.abs(filled - log.odometry).max() < 0.2 * np.abs(stalled - log.odometry).max()


def test_a_pause_of_the_recording_explains_a_leap() -> None:
    leap = _straight(101)
    leap[51:55] = leap[50]
    times = np.arange(101) / 5.0
    assert not np.array_equal(_filled(leap, times), leap)
    times[55:] += 1.0
    np.testing.assert_array_equal(_filled(leap, times), leap)


@pytest.mark.parametrize(("leap", "n"), [(3.0, 60), (10.0, 30)])
def test_odometry_that_is_set_anew_while_the_robot_stands_was_not_held(log: Log, leap: float, n: int) -> None:
    """A laser that sees no change, or a way that nobody goes in the time, tells."""
    indices = np.concatenate([np.arange(400), np.full(n, 400), np.arange(400, len(log))])
    odometry = log.odometry[indices]
    odometry[400 + n :, 0] += leap
    rng = np.random.default_rng(1)
    ranges = log.ranges[indices] + rng.normal(0.0, 0.005, (len(indices), log.ranges.shape[1])).astype(np.float32)
    stood = replace(log, odometry=odometry, ranges=ranges, stamps=np.arange(len(indices)) / 5.0)
    assert with_odometry_between_readings(stood, StandstillConfig()) is stood


def test_the_odometry_of_mit_csail_stalls_three_times_for_a_second(data_dir: Path) -> None:
    log = read_log(data_dir / "mit-csail.clf.gz")
    moves, spread = held_readings(log.odometry, waits(log.stamps), StandstillConfig())
    assert list(zip(moves[spread > 1].tolist(), spread[spread > 1].tolist(), strict=True)) == [
        (324, 5),
        (801, 5),
        (1583, 5),
    ]


def test_odometry_read_at_every_scan_is_left_alone(log: Log) -> None:
    assert with_odometry_between_readings(log, StandstillConfig()) is log
    short = replace(log, odometry=log.odometry[:1], ranges=log.ranges[:1], stamps=log.stamps[:1])
    assert with_odometry_between_readings(short, StandstillConfig()) is short


def test_a_run_is_told_that_odometry_was_interpolated(log: Log) -> None:
    stalled = log.odometry.copy()
    stalled[401:405] = stalled[400]
    better = with_odometry_between_readings(replace(log, odometry=stalled), StandstillConfig())
    assert better.warnings[-1] == (
        "the odometry repeats a reading in 4 scans while the robot moves, and makes up for it at once, first at scan "
        "401: it is interpolated in between"
    )


def test_odometry_that_stops_counting_is_dead_from_there_on(log: Log) -> None:
    dying = log.odometry[np.minimum(np.arange(len(log)), 900)]
    assert dead_intervals(dying, log.ranges, StandstillConfig()) == [(900, len(log) - 1)]
    pausing = log.odometry.copy()
    pausing[500:560] = pausing[500]
    assert dead_intervals(pausing, log.ranges, StandstillConfig()) == [(500, 559)]


def test_a_robot_that_stands_among_noise_and_people_has_no_dead_odometry(log: Log) -> None:
    assert not dead_intervals(log.odometry, log.ranges, StandstillConfig())
    rng = np.random.default_rng(1)
    standing = np.tile(log.ranges[300], (400, 1)) + rng.normal(0.0, 0.03, (400, log.ranges.shape[1]))
    standing[rng.random(standing.shape) < 0.3] = 0.7
    covered = standing.astype(np.float32)
    covered[100:200] = np.nan
    assert not dead_intervals(np.tile([3.0, 2.0, 1.0], (400, 1)), covered, StandstillConfig())


def test_a_laser_that_sees_the_move_a_little_before_the_odometry_does_is_no_contradiction(log: Log) -> None:
    moving = log.ranges[500:560]
    ranges = np.concatenate([np.tile(moving[0], (40, 1)), moving])
    late = 2
    odometry = np.concatenate([np.tile(log.odometry[500], (40 + late, 1)), log.odometry[500 : 560 - late]])
    assert not dead_intervals(odometry, ranges, StandstillConfig())


def _among_trunks(step: float) -> NDArray[np.float64]:
    """(100, 360) ranges of 8 m among trunks, a step [m] from each scan to the next; few return, and seldom twice."""
    rng = np.random.default_rng(3)
    trunks, bearings = rng.uniform((-6.0, -15.0), (56.0, 15.0), (90, 2)), np.arange(-180, 180) * (np.pi / 180.0)
    ranges = np.full((100, 360), np.inf)
    for row, x in enumerate(step * np.arange(100)):
        offset = trunks - (x, 0.0)
        aside = offset[:, 1, None] * np.cos(bearings) - offset[:, 0, None] * np.sin(bearings)
        ahead = offset[:, 0, None] * np.cos(bearings) + offset[:, 1, None] * np.sin(bearings)
        distance = np.where((np.abs(aside) < 0.15) & (ahead > 0.0), ahead, np.inf)
        ranges[row] = distance.min(axis=0)
    noisy = ranges + rng.normal(0.0, 0.02, ranges.shape)
    return np.where(noisy < 8.0, noisy, np.nan)


def test_where_hardly_a_beam_returns_in_two_scans_those_that_return_in_one_tell_of_a_move() -> None:
    moving = _among_trunks(0.4).astype(np.float32)
    assert 10 < np.median(np.count_nonzero(np.isfinite(moving), axis=1)) < 90
    assert dead_intervals(np.zeros((100, 3)), moving, StandstillConfig()) == [(0, 99)]
    assert not dead_intervals(np.zeros((100, 3)), _among_trunks(0.0).astype(np.float32), StandstillConfig())


def test_a_robot_whose_scans_match_nothing_is_lost_and_does_not_stand_still() -> None:
    """Neither odometry nor matches tell how far it went: what no motion is known of is no standstill."""
    bearings, odometry = np.arange(-180, 180) * (np.pi / 180.0), np.zeros((100, 3))
    odometry[0, 0] = -1.0
    log = Log.from_arrays(_among_trunks(3.0), bearings=bearings, odometry=odometry)
    track = track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())
    assert track.dead == [(1, 99)]
    assert track.lost
    assert len(track.keys) > 20


def test_what_is_held_for_long_is_no_arc(log: Log) -> None:
    held = replace(log, odometry=_held(log.odometry, 3))
    filled = with_odometry_between_readings(held, StandstillConfig())
    assert not np.array_equal(filled.odometry, held.odometry)
    shorter = 1.5 * float(np.median(np.diff(log.stamps)))
    long_held = StandstillConfig(held_longest=shorter, held_scans=1)
    assert with_odometry_between_readings(held, long_held) is held
    numbered = replace(held, stamps=np.linspace(0.0, 1e4, len(log)))
    assert not np.array_equal(with_odometry_between_readings(numbered, StandstillConfig()).odometry, held.odometry)
