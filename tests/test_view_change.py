"""How much the view changes from scan to scan, and what follows for a robot that may have been carried."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.scan import Log
from frontends.simulator.simulation import Simulation, simulate
from graph.measurement import NoMatch
from graph.odometry import OdometryModel
from graph.se2 import between, compose
from iceg.evaluation.degradation import carried
from iceg.ice.matcher import IceMatcher
from iceg.slam.broken_path.path_break import FailureKind, TrackingFailure
from iceg.slam.broken_path.view_change import ViewChanges, _log_odds_carried, judged_by_view
from iceg.slam.closure_config import TrackingFailureConfig, ViewChangeConfig
from iceg.slam.track import KeyScan, Track

_EVERY = 5
_CONFIG = ViewChangeConfig()


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return simulate("office", seed=2)


def _views(log: Log, poses: NDArray[np.float64], config: ViewChangeConfig = _CONFIG) -> ViewChanges:
    """Of a path that is known, every fifth scan a key scan."""
    keys = [
        KeyScan(
            index=index,
            scan=log.scan(index),
            motion=OdometryModel().start(),
            match=NoMatch(reason="nothing"),
            anchor=0,
            T_track_robot=poses[index],
        )
        for index in range(0, len(log), _EVERY)
    ]
    key_of_scan = np.arange(len(log)) // _EVERY
    T_key_scan = between(poses[_EVERY * key_of_scan], poses)
    track = Track(keys=keys, key_of_scan=key_of_scan, T_key_scan=T_key_scan, failures=0, lost=[])
    return ViewChanges(log, track, IceMatcher(), config)


def _carried(simulation: Simulation) -> tuple[ViewChanges, int]:
    """A robot that is carried, and the scan before."""
    degraded = carried(simulation.log)
    poses, at = simulation.truth[degraded.scans], int(np.argmax(np.diff(degraded.scans)))
    poses[at + 1 :] = compose(poses[at], between(poses[at + 1], poses[at + 1 :]))
    return _views(degraded.log, poses), at


def test_the_view_of_a_robot_that_drives_changes_little(simulation: Simulation) -> None:
    views = _views(simulation.log, simulation.truth)
    n_keys = len(views.track.keys)
    likely = [key for key in range(1, n_keys) if (views.bayes_factor(views.steps(key, 1)) or 0.0) >= 10.0]
    assert len(likely) <= 0.01 * n_keys


def test_that_of_one_that_is_carried_changes_as_it_never_does_by_chance(simulation: Simulation) -> None:
    views, at = _carried(simulation)
    factor = views.bayes_factor(np.array([at]))
    assert factor is not None
    assert factor > 300.0
    others = [views.bayes_factor(np.array([at + offset])) for offset in (-20, -1, 1, 20)]
    assert max(other for other in others if other is not None) < 1.0


def test_a_way_that_was_not_recorded_changes_the_view_as_much_as_one_that_was(simulation: Simulation) -> None:
    """Who drives on while the recorder pauses was not carried, if odometry and match tell the way."""
    factors = []
    for first in range(100, len(simulation.log) - 200, 200):
        scans = np.delete(np.arange(len(simulation.log)), np.arange(first + 1, first + 40))
        log, poses = simulation.log.select(scans), simulation.truth[scans]
        views = _views(replace(log, odometry=poses), poses)
        odometry = poses.copy()
        odometry[first + 1 :] = compose(poses[first], between(poses[first + 1], poses[first + 1 :]))
        stood_still = _views(replace(log, odometry=odometry), poses)
        factors.append(
            [views.bayes_factor(np.array([first])) or 0.0, stood_still.bayes_factor(np.array([first])) or 0.0]
        )
    drove, carried_there = np.log(factors).T
    assert np.median(carried_there) > 3.0, "where odometry knows nothing of the way he was carried"
    assert np.median(drove) < 0.0
    assert drove.max() < 2.0


def test_one_of_many_steps_says_as_much_less_as_there_are_others(simulation: Simulation) -> None:
    views, at = _carried(simulation)
    alone, among = (views.bayes_factor(steps) for steps in (np.array([at]), np.arange(at - 9, at + 1)))
    assert alone is not None
    assert among == pytest.approx(alone / 10.0, rel=0.01)


def test_where_tracking_comes_back_is_not_where_the_robot_was_carried(simulation: Simulation) -> None:
    views, at = _carried(simulation)
    poses = views._T_track_robot.copy()
    poses[at + 1 : at + 4] = compose(poses[at + 1 : at + 4], [0.7, 0.3, 0.8])  # astray for three scans
    log = replace(views.log, odometry=views._T_track_robot)
    assert _views(log, poses).after_largest(np.arange(at - 5, at + 8)) == (at // _EVERY + 1, at + 1)


def test_poses_that_are_wrong_by_little_change_no_view(simulation: Simulation) -> None:
    """Odometry may jump, or a match be wrong by a hand's breadth: what the laser sees goes on all the same."""
    poses, step = simulation.truth.copy(), 700
    poses[step:] = compose(compose(poses[step], [0.02, -0.02, 0.003]), between(poses[step], poses[step:]))
    factor = _views(simulation.log, poses).bayes_factor(np.array([step - 1]))
    assert factor is not None
    assert factor < 1.0


def test_tracking_that_goes_astray_for_a_scan_changes_no_view(simulation: Simulation) -> None:
    """The two scans, matched to each other, agree; and robots that are carried see something else altogether."""
    poses, step = simulation.truth.copy(), 700
    poses[step] = compose(poses[step], [0.25, -0.1, 0.05])
    views = _views(simulation.log, poses)
    astray = np.array([step - 1])
    assert views._ratio(float(views._changes(astray)[0]), views._usual(1)) > 10.0
    factor = views.bayes_factor(astray)
    assert factor is not None
    assert factor < 1.0
    assert float(np.median(views._elsewhere)) > 0.2


def test_nothing_is_said_of_a_laser_that_is_covered(simulation: Simulation) -> None:
    ranges = simulation.log.ranges.copy()
    ranges[500:510] = np.nan
    views = _views(replace(simulation.log, ranges=ranges), simulation.truth)
    assert views.bayes_factor(np.arange(500, 505)) == 1.0
    assert views.bayes_factor(np.arange(480, 490)) != 1.0


def test_a_beam_without_return_looks_through_what_was_there() -> None:
    ranges = np.full((2, 181), 4.0, np.float32)
    ranges[1, :90] = np.nan
    views = _views(Log.from_arrays(ranges, bearings=np.radians(np.arange(181.0) - 90.0)), np.zeros((2, 3)))
    assert views._changes(np.array([0]))[0] == pytest.approx(45 / (91 + 46), abs=0.03)  # every other beam


def test_walls_that_are_gone_change_the_view_though_hardly_anything_is_left_to_compare() -> None:
    ranges = np.full((3, 181), 4.0, np.float32)
    ranges[1, 6:] = np.nan
    ranges[2] = np.nan
    views = _views(Log.from_arrays(ranges, bearings=np.radians(np.arange(181.0) - 90.0)), np.zeros((3, 3)))
    gone, blind = views._changes(np.array([0, 1]))
    assert gone > 0.9
    assert np.isnan(blind)


def test_nor_by_a_log_of_few_scans(simulation: Simulation) -> None:
    views = _views(simulation.log, simulation.truth, replace(_CONFIG, min_steps=10**6))
    assert views.bayes_factor(np.arange(495, 505)) is None


def test_a_whole_turn_is_compared_across_its_ends() -> None:
    log = Log.from_arrays(np.full((2, 360), 4.0), bearings=np.radians(np.arange(360.0) - 180.0))
    for turn in (0.0, 0.5, 3.0, -3.0):
        views = _views(log, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, turn]]))
        np.testing.assert_array_equal(views._changes(np.array([0])), [0.0])


@pytest.mark.parametrize(("turn", "share"), [(0.0, 1.0), (0.5, 1.0 - 0.5 / np.pi)])
def test_only_beams_that_both_scans_have_are_compared(turn: float, share: float) -> None:
    log = Log.from_arrays(np.full((2, 181), 4.0), bearings=np.radians(np.arange(181.0) - 90.0))
    views = _views(log, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, turn]]))
    agreeing, compared = views._compared(np.array([1]), np.array([0]), np.array([[0.0, 0.0, turn]]))
    assert agreeing == compared
    assert compared[0] / 91 == pytest.approx(share, abs=0.02)  # every other beam is looked at


def _told_by(elsewhere: NDArray[np.float64]) -> ViewChanges:
    views = object.__new__(ViewChanges)
    object.__setattr__(views, "config", _CONFIG)
    views.__dict__.update(_elsewhere=elsewhere)
    return views


@given(shape=st.floats(0.2, 1.0), along=st.floats(0.01, 0.99))
def test_beyond_what_the_log_has_seen_a_pareto_tail_goes_on(shape: float, along: float) -> None:
    """Against changes that are uniform for a robot that is carried, the ratio is one over the density of the tail."""
    usual = 0.02 * (1.0 - (np.arange(2000) + 0.5) / 2000) ** -shape  # quantiles of a Pareto distribution
    views = _told_by((np.arange(10_000) + 0.5) / 10_000)
    start = float(np.quantile(usual, 1.0 - _CONFIG.tail))
    least, most = start + _CONFIG.window, 1.0 - _CONFIG.window  # the window is whole in between
    change = least + along * (most - least)
    density = _CONFIG.tail * (change / start) ** (-1.0 / shape) / (shape * change)
    assert views._ratio(change, usual) == pytest.approx(1.0 / density, rel=0.3)


@given(usual=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=80), change=st.floats(0.0, 1.0))
def test_any_change_of_view_makes_carrying_so_many_times_as_probable(usual: list[float], change: float) -> None:
    views, changes = _told_by(np.linspace(0.0, 1.0, 60)), np.sort(usual)
    assert 0.0 < views._ratio(change, changes) < np.inf
    assert views._ratio(float("nan"), changes) == 1.0
    assert views._ratio(change, changes[:0]) == 1.0


@pytest.mark.parametrize("is_dead", [False, True])
def test_new_ground_is_no_loss_where_odometry_told_the_way(simulation: Simulation, *, is_dead: bool) -> None:
    views, at = _carried(simulation)
    if is_dead:
        views = replace(views, track=replace(views.track, dead=[(0, len(views.log) - 1)]))
    loss = TrackingFailure(kind=FailureKind.TRACKING_LOSS, reason="nothing matched what was known before")
    carried_key, other = at // _EVERY + 1, 40
    judged = judged_by_view({carried_key: loss, other: loss}, (), views, TrackingFailureConfig())
    assert judged[carried_key].is_lost
    assert judged[other].is_lost == is_dead


def test_without_odometry_new_ground_may_be_anywhere(simulation: Simulation) -> None:
    log = replace(simulation.log, has_odometry=False)
    loss = TrackingFailure(kind=FailureKind.TRACKING_LOSS, reason="nothing matched what was known before")
    (judged,) = judged_by_view({40: loss}, (), _views(log, simulation.truth), TrackingFailureConfig()).values()
    assert judged.is_lost


def test_what_nothing_but_carrying_explains_is_a_loss(simulation: Simulation) -> None:
    views, at = _carried(simulation)
    carried_key, other = at // _EVERY + 1, 40
    beyond = TrackingFailure(kind=FailureKind.INCONSISTENT, reason="the match lies far off", distance2=1000.0)
    judged = judged_by_view({carried_key: beyond, other: beyond}, (), views, TrackingFailureConfig())
    assert judged[carried_key].is_lost
    assert judged[carried_key].reason == "what the laser sees changed at once, and the match lies far off"
    assert not judged[other].is_lost
    assert not judged[other].is_carried


def test_the_more_often_tracking_fails_the_less_one_failure_says(simulation: Simulation) -> None:
    views, at = _carried(simulation)
    carried_key = at // _EVERY + 1
    failure = TrackingFailure(kind=FailureKind.NO_MATCH, reason="nothing matched")
    (alone,) = judged_by_view({carried_key: failure}, (), views, TrackingFailureConfig()).values()
    many = dict.fromkeys((*range(10, 30), carried_key), failure)
    among = judged_by_view(many, (), views, TrackingFailureConfig())[carried_key]
    assert alone.log_odds_carried is not None
    assert among.log_odds_carried is not None
    usual = _CONFIG.usual_failures
    assert alone.log_odds_carried - among.log_odds_carried == pytest.approx(np.log((20 + usual) / usual), abs=0.1)


def test_who_was_carried_twice_was_not_lost_for_another_cause() -> None:
    failure, config = TrackingFailure(kind=FailureKind.NO_MATCH, reason="nothing matched"), _CONFIG
    alone = _log_odds_carried({1: failure}, {1: 18.0}, config)[1]
    twice = _log_odds_carried({1: failure, 2: failure}, {1: 18.0, 2: 1e6}, config)[1]
    beside = _log_odds_carried({1: failure, 2: failure}, {1: 18.0, 2: 1e-6}, config)[1]
    assert alone == pytest.approx(np.log(18.0 * config.carried_prior / config.usual_failures))
    assert twice == pytest.approx(alone, abs=0.01)
    assert beside == pytest.approx(alone - np.log(1.0 + 1.0 / config.usual_failures), abs=0.01)
    assert 2 not in _log_odds_carried({1: failure, 2: failure}, {1: 18.0}, config)


@pytest.mark.parametrize(("distance2", "expected"), [(25.0, 0.1), (1e9, 20.0), (1e3, 1.0 / (0.95 * 0.25 + 0.05))])
def test_a_contradiction_of_any_magnitude_is_that_of_a_robot_that_is_carried(distance2: float, expected: float) -> None:
    failure = TrackingFailure(kind=FailureKind.INCONSISTENT, reason="the match lies far off", distance2=distance2)
    assert failure.contradiction(25.0, ViewChangeConfig()) == pytest.approx(expected, rel=0.06)
    assert replace(failure, kind=FailureKind.NO_MATCH).contradiction(25.0, ViewChangeConfig()) == 1.0


def test_what_closures_have_settled_is_asked_only_where_the_view_is_new(simulation: Simulation) -> None:
    views, at = _carried(simulation)
    carried_key = at // _EVERY + 1
    failure = TrackingFailure(kind=FailureKind.NO_MATCH, reason="nothing matched")
    many = dict.fromkeys((*range(10, 30), carried_key), failure)
    asked = judged_by_view(many, (), views, TrackingFailureConfig())
    judged = judged_by_view(many, many, views, TrackingFailureConfig())
    assert all(judged[key].log_odds_carried is None for key in range(10, 30))
    assert judged[carried_key].log_odds_carried == pytest.approx(asked[carried_key].log_odds_carried, abs=0.1)
