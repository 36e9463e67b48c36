"""Recognised places that fit several ways: the set that agrees picks, and two such sets close nothing."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.simulator.simulation import simulate
from graph.config import PoseGraphConfig
from graph.factors import Factor
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between, compose
from iceg.ice.matcher import IceMatcher
from iceg.slam import back_end
from iceg.slam.broken_path import place_search, relocalisation
from iceg.slam.broken_path.bridge_edges import BridgeEdges
from iceg.slam.broken_path.hypothesis_verification import FitCount
from iceg.slam.broken_path.map_search import MapSearch
from iceg.slam.broken_path.path_break import FailureKind, TrackingFailure
from iceg.slam.broken_path.place_hypothesis import Hypothesis, about_single_steps
from iceg.slam.broken_path.relocalisation import relocalise
from iceg.slam.closure_config import RelocalisationConfig, TrackingFailureConfig
from iceg.slam.closures.attempt import Attempt, Place, closure_factor
from iceg.slam.closures.candidates import Candidate
from iceg.slam.config import FrontEndConfig, LoopClosureConfig
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.solution import Solution
from iceg.slam.track import Track
from iceg.slam.tracking.log_tracking import track_log

Array = NDArray[np.float64]

_BREAK, _AGAIN, _EARLIER = 100, range(110, 150, 4), 20
_HERE, _THERE = np.array([5.0, -2.0, 0.3]), np.array([-4.0, 7.0, -0.2])
"""What moves the poses after the break to where they are, and to a similar place."""


@pytest.fixture(scope="module")
def track() -> Track:
    log = simulate("office", seed=1).log.select(slice(1500))
    return track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())


_carried = partial(TrackingFailure, log_odds_carried=100.0)
"""A failure at which the robot sees something else at once."""


def _poses(track: Track) -> Array:
    return np.array([key.T_track_robot for key in track.keys])


def _path(track: Track) -> list[Factor]:
    poses, step = _poses(track), np.diag([0.02, 0.02, 0.01]) ** 2
    first = Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=step)
    return [first] + [
        Factor(kind="odometry", i=k, j=k + 1, T_i_j=between(poses[k], poses[k + 1]), covariance=step)
        for k in range(len(poses) - 1)
    ]


class _Closer(LoopCloser):
    """Finds each key scan to fit the earlier one in the places it was given, the first of them the best."""

    def __init__(
        self, track: Track, places: Mapping[int, Sequence[Array]], config: LoopClosureConfig | None = None
    ) -> None:
        super().__init__(IceMatcher(), track, config or LoopClosureConfig())
        self._script = places

    def match_anywhere(self, key_old: int, key_new: int, poses: Array) -> Attempt:
        del poses
        there = [Place(T_old_new=T, misfit=0.02) for T in self._script[key_new]]
        return self._attempt(key_old, key_new, there, is_only=len(there) == 1)

    def match(self, candidate: Candidate, poses: Array) -> Attempt:
        del poses
        there = Place(T_old_new=candidate.T_old_new, misfit=0.02)
        return self._attempt(candidate.key_old, candidate.key_new, [there], is_only=True)

    def _attempt(self, key_old: int, key_new: int, places: list[Place], *, is_only: bool) -> Attempt:
        match = RelativePose(
            T_ref_cur=places[0].T_old_new,
            covariance=np.diag([0.02, 0.02, 0.01]) ** 2,
            score=0.9,
            inliers=150,
            overlap=0.9,
            weak_directions=np.zeros((0, 3)),
        )
        reason = "scripted" if is_only else f"{len(places)} places fit; scripted"
        return Attempt(
            key_old=key_old, key_new=key_new, match=match, accepted=is_only, reason=reason, places=tuple(places)
        )


class _HypothesisVerifier:
    """Every hypothesis gets as many votes as it has closures, the estimate none."""

    def __init__(self, closer: LoopCloser) -> None:
        del closer

    against = 0
    """Votes against every hypothesis."""

    def of_hypothesis(self, hypothesis: Hypothesis, poses: Array) -> FitCount:
        del poses
        return FitCount(agreeing=list(hypothesis.closures), against=self.against)

    def of_estimate(self, hypothesis: Hypothesis, poses: Array, among: NDArray[np.bool_] | None = None) -> FitCount:
        del hypothesis, poses, among
        return FitCount(agreeing=[], against=0)


@pytest.fixture(autouse=True)
def _maps_tell_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """What similar places alone say."""
    monkeypatch.setattr(MapSearch, "ways", lambda *_: [])
    monkeypatch.setattr(MapSearch, "contradict", lambda *_: False)


def _relocalised(
    track: Track,
    places: Mapping[int, Sequence[Array]],
    monkeypatch: pytest.MonkeyPatch,
    kind: FailureKind | None = FailureKind.TRACKING_LOSS,
    spanning: Sequence[Attempt] = (),
    config: LoopClosureConfig | None = None,
) -> Solution:
    """With the places found similar; closures found on the way span the path."""
    monkeypatch.setattr(place_search, "similar_places", lambda *_: [(_EARLIER, key) for key in places])
    monkeypatch.setattr(relocalisation, "HypothesisVerifier", _HypothesisVerifier)
    return _searched(track, places, kind, spanning, config)


def _searched(
    track: Track,
    places: Mapping[int, Sequence[Array]],
    kind: FailureKind | None = FailureKind.TRACKING_LOSS,
    spanning: Sequence[Attempt] = (),
    config: LoopClosureConfig | None = None,
) -> Solution:
    factors = _path(track) + [closure_factor(closure) for closure in spanning]
    before = _solution(factors, _poses(track), spanning)
    failures = {}
    if kind is not None:
        failures[_BREAK] = _carried(reason="nothing matched what was known before", kind=kind)
    return relocalise(_Closer(track, places, config), before, failures)


def _solution(factors: list[Factor], poses: Array, attempts: Sequence[Attempt] = ()) -> Solution:
    everywhere = np.ones(len(poses), dtype=np.bool_)
    return Solution(factors=factors, poses=poses, attempts=list(attempts), searchable=everywhere)


def _moved(track: Track, key: int, correction: Array) -> Array:
    poses = _poses(track)
    return between(poses[_EARLIER], compose(correction, poses[key]))


def _by_chance(key: int) -> Array:
    return np.random.default_rng(key).uniform([-9.0, -9.0, -3.0], [9.0, 9.0, 3.0])


def test_the_set_that_agrees_picks_among_the_places_of_each(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    # Each fits somewhere else best: only the second best of all is the same place.
    found = _relocalised(track, {k: [_by_chance(k), _moved(track, k, _HERE)] for k in _AGAIN}, monkeypatch)
    (at,) = found.breaks
    assert (at.key, at.outcome) == (_BREAK, "joined")
    assert found.ambiguous == ()
    accepted = [attempt for attempt in found.attempts if attempt.accepted]
    assert [attempt.key_new for attempt in accepted] == list(_AGAIN)
    key = _AGAIN[3]
    np.testing.assert_allclose(between(found.poses[_EARLIER], found.poses[key]), _moved(track, key, _HERE), atol=0.05)


@pytest.mark.parametrize(
    ("n_alone", "kind", "expected"),
    [
        (4, FailureKind.NO_MATCH, ["joined"]),
        (3, 1.0, []),
        (3, FailureKind.NO_MATCH, []),
    ],
)
def test_a_path_that_was_not_lost_is_not_broken_by_what_fits_elsewhere_too(
    track: Track, monkeypatch: pytest.MonkeyPatch, n_alone: int, kind: FailureKind, expected: list[str]
) -> None:
    places = {k: [_moved(track, k, _HERE), _by_chance(k)] for k in _AGAIN}
    for key in list(_AGAIN)[:n_alone]:
        places[key] = places[key][:1]
    found = _relocalised(track, places, monkeypatch, kind=kind)
    assert [at.outcome for at in found.breaks] == expected
    if expected != ["joined"]:
        np.testing.assert_array_equal(found.poses, _poses(track))
    for at in found.breaks:
        moved = np.hypot(*(compose(_HERE, _poses(track)[_BREAK]) - _poses(track)[_BREAK])[:2])
        assert at.moved == pytest.approx(moved, abs=0.1)
        assert at.closures == len(_AGAIN)


def _over_the_whole_path(track: Track) -> Attempt:
    """A closure that says what the path says."""
    poses, last = _poses(track), len(track.keys) - 1
    return _Closer(track, {last: [between(poses[0], poses[last])]}).match_anywhere(0, last, poses)


@pytest.mark.parametrize(("log_odds", "outcome"), [(3.0, "joined"), (-2.0, "contradicted"), (None, "apart")])
def test_who_goes_on_seeing_the_same_is_not_put_where_places_are_similar(
    track: Track, monkeypatch: pytest.MonkeyPatch, log_odds: float | None, outcome: str
) -> None:
    monkeypatch.setitem(globals(), "_carried", partial(TrackingFailure, log_odds_carried=log_odds))
    found = _relocalised(track, {k: [_moved(track, k, _HERE)] for k in _AGAIN}, monkeypatch)
    assert [at.outcome for at in found.breaks] == [outcome]
    assert np.array_equal(found.poses, _poses(track)) == (outcome != "joined")


@pytest.mark.parametrize("is_known", [True, False])
def test_what_the_path_does_not_know_takes_no_robot_that_was_carried(
    track: Track, monkeypatch: pytest.MonkeyPatch, *, is_known: bool
) -> None:
    monkeypatch.setattr(relocalisation, "HypothesisVerifier", _HypothesisVerifier)
    places = {k: [_moved(track, k, _HERE)] for k in _AGAIN}
    monkeypatch.setattr(place_search, "similar_places", lambda *_: [(_EARLIER, key) for key in places])
    unknown = np.diag([400.0, 400.0, 10.0])
    path = [
        factor if is_known or factor.j != _BREAK else replace(factor, covariance=unknown) for factor in _path(track)
    ]
    before = _solution(path, _poses(track))
    failures = {_BREAK: TrackingFailure(kind=FailureKind.UNKNOWN_MOTION, reason="nothing told the way there")}
    found = relocalise(_Closer(track, places), before, failures)
    assert any(attempt.accepted for attempt in found.attempts) != is_known
    assert [at.outcome for at in found.breaks] == ["apart"] * is_known


def test_two_sets_about_as_strong_close_nothing_and_it_is_said(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    places = {k: [_moved(track, k, _HERE), _moved(track, k, _THERE)] for k in _AGAIN}
    places[_AGAIN[0]] = places[_AGAIN[0]][:1]  # one more for the first
    found = _relocalised(track, places, monkeypatch)
    assert [at.outcome for at in found.breaks] == ["apart"]
    assert not any(attempt.accepted for attempt in found.attempts)
    (vote,) = found.ambiguous
    assert (vote.first, vote.last) == (_AGAIN[0], _AGAIN[-1])
    assert (vote.count, vote.rival) == (len(_AGAIN), len(_AGAIN) - 1)
    poses = _poses(track)
    apart = [np.hypot(*(compose(_HERE, pose) - compose(_THERE, pose))[:2]) for pose in poses[list(_AGAIN)]]
    assert min(apart) - 0.1 < vote.apart < max(apart) + 0.1


def test_two_places_that_both_beat_the_path_are_told_though_closures_hold_the_path(
    track: Track, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = {k: [_moved(track, k, _HERE), _moved(track, k, _THERE)] for k in _AGAIN}
    for key in list(_AGAIN)[:4]:  # enough that fit one place only
        places[key] = places[key][:1]
    as_it_is = _Closer(track, {k: [_moved(track, k, np.zeros(3))] for k in (112, 116, 120)})
    spanning = [as_it_is.match_anywhere(_EARLIER, key, _poses(track)) for key in (112, 116, 120)]
    found = _relocalised(track, places, monkeypatch, kind=FailureKind.NO_MATCH, spanning=spanning)
    assert [attempt for attempt in found.attempts if attempt.accepted] == spanning
    assert found.breaks == ()
    (vote,) = found.ambiguous
    assert (vote.count, vote.rival) == (len(_AGAIN), len(_AGAIN) - 4)
    # nor do they settle it for the back end
    monkeypatch.setattr(back_end, "relocalise", lambda *_: found)
    without: list[None] = [None] * (len(track.keys) - 1)
    closer = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    solution = back_end.solve_track(closer, without, PoseGraphConfig())
    assert solution.ambiguous == (vote,)


@pytest.mark.parametrize(("n_spanning", "outcomes"), [(0, ["contradicted"]), (1, ["contradicted"]), (3, [])])
def test_closures_that_hold_the_path_speak_against_those_that_contradict_it(
    track: Track, monkeypatch: pytest.MonkeyPatch, n_spanning: int, outcomes: list[str]
) -> None:
    # Eight agree, too far off for drift; each that holds the path takes two with it, and six must be left.
    far = np.array([40.0, -30.0, 2.0])
    config = LoopClosureConfig(failures=TrackingFailureConfig(min_inlier_ratio=2.0, believed_inlier_ratio=2.0))
    spanning = [_over_the_whole_path(track)] * n_spanning
    places = {k: [_moved(track, k, far)] for k in _AGAIN}
    found = _relocalised(track, places, monkeypatch, kind=None, spanning=spanning, config=config)
    assert [at.outcome for at in found.breaks] == outcomes


@pytest.mark.parametrize(("n_bridges", "has_failed", "expected"), [(8, True, 120), (8, False, 8), (50, False, 50)])
def test_few_pairs_are_matched_where_tracking_never_failed_and_bridges_are_few(
    track: Track, monkeypatch: pytest.MonkeyPatch, n_bridges: int, has_failed: bool, expected: int
) -> None:
    asked: list[int] = []

    def similar(track: Track, judge: IceMatcher, parts: NDArray[np.int64], config: LoopClosureConfig) -> list[Any]:
        del track, judge, parts
        asked.append(config.places)
        return []

    monkeypatch.setattr(place_search, "similar_places", similar)
    config, first, last = LoopClosureConfig(), 90, len(track.keys) - 1
    closer = _Closer(track, {key: [np.zeros(3)] for key in range(last + 1)})
    # with all the key scans they rest on, they span the path up to the first step and after the last one
    before = closer.match_anywhere(0, first - 1 - min(config.support_offsets), _poses(track))
    after = closer.match_anywhere(first + n_bridges - 1 - config.reference_half, last, _poses(track))
    spanning = [before] * 20 + [after] * 20  # as many as settle what little explains
    solution = _solution(_path(track) + [closure_factor(c) for c in spanning], _poses(track), spanning)
    failures = {first: _carried(reason="the odometry jumped", kind=FailureKind.NO_MATCH)} if has_failed else {}
    relocalise(closer, solution, failures)
    assert asked == [expected]


def test_a_set_with_far_fewer_is_no_rival(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    few = list(_AGAIN)[:4]
    both = {k: [_moved(track, k, _HERE), _moved(track, k, _THERE)] for k in few}
    alone = {k: [_moved(track, k, _HERE)] for k in _AGAIN if k not in few}
    found = _relocalised(track, both | alone, monkeypatch)
    assert [at.outcome for at in found.breaks] == ["joined"]
    assert found.ambiguous == ()


def test_an_ambiguous_place_that_confirms_the_path_says_nothing(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    as_it_is = np.zeros(3)
    alone = _relocalised(track, {k: [_moved(track, k, as_it_is)] for k in _AGAIN}, monkeypatch)
    assert sum(attempt.accepted for attempt in alone.attempts) == len(_AGAIN)
    found = _relocalised(track, {k: [_moved(track, k, as_it_is), _by_chance(k)] for k in _AGAIN}, monkeypatch)
    assert not any(attempt.accepted for attempt in found.attempts)


def test_a_part_that_only_a_later_one_is_tied_to_moves_with_it(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    # More key scans tell how the third part lies to the second than how it lies to the first.
    before, second, third, poses = 60, 70, _BREAK, _poses(track)
    again, first_again = range(105, 135, 3), range(140, 165, 4)
    T_map_second, T_map_third = compose(_THERE, poses[second]), [compose(_HERE, pose) for pose in poses]
    places = {key: [between(T_map_second, T_map_third[key])] for key in again}
    places |= {key: [between(poses[_EARLIER], T_map_third[key])] for key in first_again}
    pairs = [(second if key in again else _EARLIER, key) for key in places]
    monkeypatch.setattr(place_search, "similar_places", lambda *_: pairs)
    monkeypatch.setattr(relocalisation, "HypothesisVerifier", _HypothesisVerifier)
    failures = {
        key: _carried(reason="nothing matched what was known before", kind=FailureKind.TRACKING_LOSS)
        for key in (before, third)
    }
    solution = _solution(_path(track), poses)
    found = relocalise(_Closer(track, places), solution, failures)
    assert [(at.key, at.outcome) for at in found.breaks] == [(before, "joined"), (third, "joined")]
    np.testing.assert_allclose(found.poses[second], T_map_second, atol=0.05)
    np.testing.assert_allclose(found.poses[120], T_map_third[120], atol=0.05)


def test_a_set_that_speaks_of_two_breaks_is_two_hypotheses(track: Track) -> None:
    def claim(key_old: int, key_new: int) -> Attempt:
        return Attempt(key_old=key_old, key_new=key_new, match=None, accepted=True, reason="scripted")

    before = [claim(20 + k, 60 + k) for k in range(4)]
    after = [claim(70 + k, 120 + k) for k in range(6)]
    failures = {
        key: _carried(reason="nothing matched what was known before", kind=FailureKind.TRACKING_LOSS)
        for key in (50, _BREAK)
    }
    steps = BridgeEdges(track, _path(track), failures, LoopClosureConfig())
    found = about_single_steps([*before, *after], steps)
    assert [(hypothesis.key, hypothesis.closures) for hypothesis in found] == [(_BREAK, after), (50, before)]


def test_of_two_steps_that_odometry_contradicts_the_one_whose_match_explains_less_is_broken(track: Track) -> None:
    scores = np.array([0.0 if isinstance(key.match, NoMatch) else key.match.score for key in track.keys])
    keys = np.arange(80, 110)
    worse, better = int(keys[scores[keys].argmin()]), int(keys[scores[keys].argmax()])
    failures = {worse: _contradicted(200.0), better: _contradicted(1000.0)}
    steps = BridgeEdges(track, _path(track), failures, LoopClosureConfig())
    closure = Attempt(key_old=70, key_new=120, match=None, accepted=True, reason="scripted")
    (found,) = about_single_steps([closure], steps)
    assert scores[worse] + 0.05 < scores[better]
    assert found.key == worse


def test_of_each_stretch_that_nothing_spans_the_match_that_explains_least_is_the_weakest(track: Track) -> None:
    scores = np.array([0.0 if isinstance(key.match, NoMatch) else key.match.score for key in track.keys])
    steps = BridgeEdges(track, _path(track), {}, LoopClosureConfig())
    steps.is_bridge[:] = False
    assert steps.weakest() == []
    steps.is_bridge[40:50] = steps.is_bridge[80:85] = True
    assert steps.weakest() == [40 + int(scores[40:50].argmin()), 80 + int(scores[80:85].argmin())]
    assert steps.weakest(besides=[83]) == [40 + int(scores[40:50].argmin())]


@pytest.mark.parametrize(("distance2", "expected"), [(50.0, _BREAK), (100.0, 50)])
def test_only_what_is_beyond_chance_outweighs_a_closure(track: Track, distance2: float, expected: int) -> None:
    # Four of five closures span the suspect step, all of them one that nothing speaks against.
    claims = [
        Attempt(key_old=old, key_new=120, match=None, accepted=True, reason="scripted") for old in (20, 25, 30, 35, 60)
    ]
    steps = BridgeEdges(track, _path(track), {50: _contradicted(distance2)}, LoopClosureConfig())
    steps.is_bridge[:] = False
    steps.is_bridge[[50, _BREAK]] = True
    (found, *_) = about_single_steps(claims, steps)
    assert found.key == expected


@pytest.mark.parametrize(("share", "outcomes"), [(0.0, []), (0.05, []), (0.5, ["drifted"]), (1.0, ["drifted"])])
def test_drift_beyond_chance_is_told(
    track: Track, monkeypatch: pytest.MonkeyPatch, share: float, outcomes: list[str]
) -> None:
    config = LoopClosureConfig(failures=TrackingFailureConfig(min_inlier_ratio=2.0))
    places = {k: [_moved(track, k, share * _HERE)] for k in _AGAIN}
    found = _relocalised(track, places, monkeypatch, kind=None, config=config)
    assert [at.outcome for at in found.breaks] == outcomes
    assert any(factor.kind == "closure" for factor in found.factors)


@pytest.mark.parametrize(
    ("is_bridge", "is_drift"), [(None, True), ((0, 60), True), ((0, 100), True), ((30, 34), False), ((50, 51), False)]
)
def test_where_something_speaks_against_a_path_it_drifts_only_along_what_no_closure_holds(
    is_bridge: tuple[int, int] | None, is_drift: bool
) -> None:
    # 80 steps of 0.1 m each explain 1.5 m; four of them do not.
    poses, covariance = np.zeros((100, 3)), np.diag([0.1, 0.1, 0.05]) ** 2
    poses[:, 0] = np.arange(100)
    step = np.array([1.0, 0.0, 0.0])
    path = [Factor(kind="odometry", i=k, j=k + 1, T_i_j=step, covariance=covariance) for k in range(99)]
    match = RelativePose(
        T_ref_cur=np.array([81.5, 0.0, 0.0]),
        covariance=covariance,
        score=0.9,
        inliers=150,
        overlap=0.9,
        weak_directions=np.zeros((0, 3)),
    )
    closure = Attempt(key_old=10, key_new=90, match=match, accepted=True, reason="scripted")
    steps = None
    if is_bridge is not None:
        steps = np.zeros(100, dtype=np.bool_)
        steps[slice(*is_bridge)] = True
    assert Hypothesis(key=50, closures=[closure]).is_drift(path, poses, RelocalisationConfig(), steps) == is_drift


def test_hypotheses_are_apart_by_how_far_they_put_the_same_scan(track: Track) -> None:
    poses, closer = _poses(track), _Closer(track, {k: [_moved(track, k, _HERE)] for k in range(104, 160)})
    here = Hypothesis(key=_BREAK, closures=[closer.match_anywhere(_EARLIER, k, poses) for k in (110, 120)])
    again = Hypothesis(key=_BREAK, closures=[closer.match_anywhere(_EARLIER, k, poses) for k in (112, 130)])
    later = Hypothesis(key=_BREAK, closures=[closer.match_anywhere(_EARLIER, k, poses) for k in (140, 150)])
    other = _Closer(track, {k: [_moved(track, k, _THERE)] for k in (112, 130)})
    there = Hypothesis(key=_BREAK, closures=[other.match_anywhere(_EARLIER, k, poses) for k in (112, 130)])
    assert here.distance_from(again, poses) == pytest.approx(0.0, abs=1e-9)
    expected = np.hypot(*(compose(_HERE, poses[112]) - compose(_THERE, poses[112]))[:2])
    assert here.distance_from(there, poses) == pytest.approx(expected)
    assert there.distance_from(here, poses) == pytest.approx(expected)
    assert there.distance_from(later, poses) == 0.0, "about other scans"


def _contradicted(distance2: float) -> TrackingFailure:
    return _carried(kind=FailureKind.INCONSISTENT, reason="", distance2=distance2)


def test_two_key_poses_are_joined_by_one_closure_only(track: Track) -> None:
    poses = _poses(track)
    before, new = _over_the_whole_path(track), len(track.keys) - 2
    factors = [*_path(track), closure_factor(before)]
    assert before.match is not None
    fresh = replace(before, key_new=new, match=replace(before.match, T_ref_cur=between(poses[0], poses[new])))
    now = _solution(factors, poses, [before]).closed([before, fresh])
    closures = [(factor.i, factor.j) for factor in now.factors if factor.kind == "closure"]
    assert closures == [(before.key_old, before.key_new), (0, new)]
    assert [(a.key_old, a.key_new) for a in now.attempts] == closures
