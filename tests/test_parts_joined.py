"""What becomes of a path where its maps belong elsewhere: joined, mended, confirmed or told apart."""

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.simulator.simulation import simulate
from graph.factors import Factor
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between, compose
from iceg.ice.matcher import IceMatcher
from iceg.slam.broken_path.bridge_edges import BridgeEdges
from iceg.slam.broken_path.geometric_verification import GeometricVerifier
from iceg.slam.broken_path.map_merging import Alignment, MapMerger
from iceg.slam.broken_path.path_break import FailureKind, TrackingFailure
from iceg.slam.broken_path.relocalisation import relocalise
from iceg.slam.closures.attempt import Attempt, closure_factor
from iceg.slam.config import FrontEndConfig, LoopClosureConfig
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.solution import Solution
from iceg.slam.track import Track
from iceg.slam.tracking.log_tracking import track_log

Array = NDArray[np.float64]

_BREAK, _AGAIN, _EARLIER = 100, range(110, 150, 4), 20
_HERE, _THERE, _ASIDE = np.array([5.0, -2.0, 0.3]), np.array([-4.0, 7.0, -0.2]), np.array([0.3, -0.2, 0.02])
"""What moves the poses after the break to where they are, to another place, and hardly."""
_STEP = np.diag([0.02, 0.02, 0.01]) ** 2


@pytest.fixture(scope="module")
def track() -> Track:
    log = simulate("office", seed=1).log.select(slice(1500))
    return track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())


_carried = partial(TrackingFailure, reason="nothing matched what was known before", log_odds_carried=2.0)
"""A failure at which the robot may see something else at once."""


def _poses(track: Track) -> Array:
    return np.array([key.T_track_robot for key in track.keys])


def _path(track: Track) -> list[Factor]:
    poses = _poses(track)
    first = Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=_STEP)
    return [first] + [
        Factor(kind="odometry", i=k, j=k + 1, T_i_j=between(poses[k], poses[k + 1]), covariance=_STEP)
        for k in range(len(poses) - 1)
    ]


def _solution(factors: list[Factor], poses: Array, attempts: Sequence[Attempt] = ()) -> Solution:
    everywhere = np.ones(len(poses), dtype=np.bool_)
    return Solution(factors=factors, poses=poses, attempts=list(attempts), searchable=everywhere)


def _closure(track: Track, key_old: int, key_new: int, correction: Array) -> Attempt:
    """Says that the later key scan is moved so."""
    poses = _poses(track)
    match = RelativePose(
        T_ref_cur=between(poses[key_old], compose(correction, poses[key_new])),
        covariance=_STEP,
        score=0.9,
        inliers=150,
        overlap=0.9,
        weak_directions=np.zeros((0, 3)),
    )
    return Attempt(key_old=key_old, key_new=key_new, match=match, accepted=True, reason="scripted")


def _alignment(
    track: Track, correction: Array, log_odds: float = 40.0, keys: Sequence[int] = _AGAIN, *, is_path: bool = False
) -> Alignment:
    closures = [_closure(track, _EARLIER, key, correction) for key in keys]
    return Alignment(correction=correction, closures=closures, log_odds=log_odds, is_path=is_path)


def _relocalised(
    track: Track,
    scripted: Mapping[int, Sequence[Alignment]],
    monkeypatch: pytest.MonkeyPatch,
    failures: Mapping[int, TrackingFailure],
    contradicted: Sequence[int] = (),
) -> tuple[Solution, Mapping[int, TrackingFailure]]:
    """By alignments that what follows each key pose has until something moves, and where maps contradict each other."""
    before = _poses(track)

    def alignments(_: MapMerger, key: int, whole: Array, fixed: Array, poses: Array) -> Sequence[Alignment]:
        del whole, fixed
        return scripted.get(key, []) if np.allclose(poses[key], before[key]) else []

    def last_of_most_probable(_: MapMerger, steps: NDArray[np.int64], log_odds: Array, *_given: object) -> int:
        return int(steps[log_odds >= log_odds.max()][-1])

    monkeypatch.setattr(MapMerger, "alignments", alignments)
    monkeypatch.setattr(MapMerger, "contradict", lambda _self, key, *_: key in contradicted)
    monkeypatch.setattr(MapMerger, "change_point", last_of_most_probable)
    closer = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    return relocalise(closer, _solution(_path(track), before), failures)


def _weakest(track: Track) -> int:
    """Of all the steps, the one that is most probably wrong."""
    steps = BridgeEdges(track, _path(track), {}, LoopClosureConfig())
    ((key, _),) = steps.chains()
    return key


def test_what_follows_a_loss_goes_where_its_map_belongs(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    ways = [
        _alignment(track, _THERE, 20.0),
        _alignment(track, _HERE),
        _alignment(track, np.zeros(3), -3.0, is_path=True),
    ]
    failures = {_BREAK: _carried(kind=FailureKind.TRACKING_LOSS)}
    found, judged = _relocalised(track, {_BREAK: ways}, monkeypatch, failures)
    (at,) = found.breaks
    assert (at.key, at.outcome, at.closures, at.probability) == (_BREAK, "joined", len(_AGAIN), 0.0)
    pose = _poses(track)[_BREAK]
    assert at.moved == pytest.approx(np.hypot(*(compose(_HERE, pose) - pose)[:2]))
    np.testing.assert_allclose(found.poses[120], compose(_HERE, _poses(track)[120]), atol=0.05)
    np.testing.assert_allclose(found.poses[:_BREAK], _poses(track)[:_BREAK], atol=0.05)
    assert judged[_BREAK].probability_carried > 0.999


def test_of_failures_that_one_move_explains_the_most_probable_is_the_break(
    track: Track, monkeypatch: pytest.MonkeyPatch
) -> None:
    later = _BREAK + 4
    ways = {_BREAK: [_alignment(track, _HERE, 20.0)], later: [_alignment(track, _HERE + 0.5 * _ASIDE, 30.0)]}
    lost = _carried(kind=FailureKind.TRACKING_LOSS)
    failures = {_BREAK: lost, later: _carried(kind=FailureKind.NO_MATCH, log_odds_carried=-2.0)}
    found, judged = _relocalised(track, ways, monkeypatch, failures)
    assert [(at.key, at.outcome) for at in found.breaks] == [(_BREAK, "joined")]
    assert judged[_BREAK].probability_carried > 0.999
    assert judged[later].probability_carried < 0.001, "explained by the other"


@pytest.mark.parametrize("broken", [60, 100, 130])
@pytest.mark.parametrize("correction", [_HERE, _THERE, np.array([0.0, 0.0, 1.5])])
def test_a_path_is_broken_where_its_scans_begin_to_fit_elsewhere(track: Track, broken: int, correction: Array) -> None:
    closer = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    maps = MapMerger(track, GeometricVerifier(closer), closer.config)
    poses, steps = _poses(track), np.arange(broken - 12, broken + 13)
    poses[broken:] = compose(between(correction, np.zeros(3)), poses[broken:])
    assert maps.change_point(steps, np.zeros(len(steps)), correction, poses) == broken
    sure = np.where(steps == broken + 5, 100.0, 0.0)
    assert maps.change_point(steps, sure, correction, poses) == broken + 5, "maps are evidence, not all there is"


def test_an_alignment_that_may_be_wrong_says_how_probably(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    ways = [_alignment(track, _HERE, 30.0), _alignment(track, _THERE, 29.0)]
    found, _ = _relocalised(track, {_BREAK: ways}, monkeypatch, {_BREAK: _carried(kind=FailureKind.TRACKING_LOSS)})
    (at,) = found.breaks
    assert at.probability == pytest.approx(1.0 / (1.0 + math.e), rel=1e-3)


def test_two_alignments_as_probable_join_nothing(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    ways = [_alignment(track, _HERE), _alignment(track, _THERE)]
    found, _ = _relocalised(track, {_BREAK: ways}, monkeypatch, {_BREAK: _carried(kind=FailureKind.TRACKING_LOSS)})
    assert [at.outcome for at in found.breaks] == ["apart"]
    np.testing.assert_array_equal(found.poses, _poses(track))


def test_a_loss_is_none_where_the_path_is_what_maps_say(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    ways = [_alignment(track, _HERE, 9.0), _alignment(track, np.zeros(3), 30.0, is_path=True)]
    failures = {_BREAK: _carried(kind=FailureKind.TRACKING_LOSS)}
    found, judged = _relocalised(track, {_BREAK: ways}, monkeypatch, failures)
    assert found.breaks == ()
    assert [attempt.key_new for attempt in found.attempts if attempt.accepted] == list(_AGAIN)
    np.testing.assert_allclose(found.poses[:, :2], _poses(track)[:, :2], atol=1e-6)
    assert judged[_BREAK].probability_carried < 1e-6


def test_maps_make_a_doubt_as_large_as_they_leave_it(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    doubtful = {_BREAK: _carried(kind=FailureKind.INCONSISTENT, log_odds_carried=-1.0)}
    path = _alignment(track, np.zeros(3), 1.0, is_path=True)
    _, judged = _relocalised(track, {_BREAK: [path]}, monkeypatch, doubtful)
    assert judged[_BREAK].log_odds_carried == pytest.approx(-2.0, abs=1e-3)  # rather than new ground
    elsewhere = LoopClosureConfig().relocalisation.maps.elsewhere
    ways = [path, _alignment(track, _HERE, elsewhere + 2.0)]
    _, judged = _relocalised(track, {_BREAK: ways}, monkeypatch, doubtful)
    assert judged[_BREAK].log_odds_carried == pytest.approx(-2.0 + np.log1p(np.exp(2.0)), abs=1e-2)
    _, judged = _relocalised(
        track, {}, monkeypatch, {_BREAK: _carried(kind=FailureKind.NO_MATCH, log_odds_carried=-9.0)}
    )
    assert judged[_BREAK].log_odds_carried == -9.0, "nobody asked"


def test_a_part_that_only_a_later_one_is_tied_to_moves_with_it(track: Track, monkeypatch: pytest.MonkeyPatch) -> None:
    before, second, poses = 60, 70, _poses(track)
    onto_second = Alignment(
        correction=_THERE, closures=[_closure(track, second, key, _THERE) for key in range(105, 135, 3)], log_odds=50.0
    )
    ways = {_BREAK: [onto_second], before: [_alignment(track, _HERE, 40.0, range(62, 90, 4))]}
    failures = {key: _carried(kind=FailureKind.TRACKING_LOSS) for key in (before, _BREAK)}
    found, _ = _relocalised(track, ways, monkeypatch, failures)
    assert [(at.key, at.outcome) for at in found.breaks] == [(before, "joined"), (_BREAK, "joined")]
    np.testing.assert_allclose(found.poses[second], compose(_HERE, poses[second]), atol=0.05)
    np.testing.assert_allclose(found.poses[120], compose(_HERE, compose(_THERE, poses[120])), atol=0.1)


@pytest.mark.parametrize(("correction", "outcome"), [(_ASIDE, "drifted"), (_HERE, "joined")])
def test_a_path_whose_maps_contradict_each_other_drifted_or_is_broken(
    track: Track, monkeypatch: pytest.MonkeyPatch, correction: Array, outcome: str
) -> None:
    weakest = _weakest(track)
    earlier, keys = weakest - 5, range(weakest + 5, weakest + 25, 2)
    closures = [_closure(track, earlier, key, correction) for key in keys]
    ways = {weakest: [Alignment(correction=correction, closures=closures, log_odds=40.0)]}
    untouched, _ = _relocalised(track, ways, monkeypatch, {})
    assert untouched.breaks == ()
    found, _ = _relocalised(track, ways, monkeypatch, {}, contradicted=[weakest])
    (at,) = found.breaks
    assert at.outcome == outcome
    assert earlier < at.key <= keys[0]
    there = compose(correction, _poses(track)[keys[3]])
    np.testing.assert_allclose(found.poses[keys[3]], there, atol=0.05)
    # drift is spread over the path, a break is not
    moved = np.hypot(*(found.poses[at.key - 1] - _poses(track)[at.key - 1])[:2])
    assert (moved > 0.01) == (outcome == "drifted")


def test_of_each_chain_that_nothing_spans_the_match_that_explains_least_is_the_weakest(track: Track) -> None:
    scores = np.array([0.0 if isinstance(key.match, NoMatch) else key.match.score for key in track.keys])
    steps = BridgeEdges(track, _path(track), {}, LoopClosureConfig())
    steps.is_bridge[:] = False
    assert steps.chains() == []
    steps.is_bridge[40:50] = steps.is_bridge[80:85] = True
    first, second = 40 + int(scores[40:50].argmin()), 80 + int(scores[80:85].argmin())
    assert [(key, chain.tolist()) for key, chain in steps.chains()] == [
        (first, list(range(40, 50))),
        (second, list(range(80, 85))),
    ]
    assert [key for key, _ in steps.chains(besides=[83])] == [first]
    assert steps.weakest(45, 82) == min((*range(45, 50), 80, 81, 82), key=lambda key: scores[key])


def test_where_nothing_failed_hardly_anybody_was_carried(track: Track) -> None:
    config = LoopClosureConfig()
    steps = BridgeEdges(track, _path(track), {_BREAK: _carried(kind=FailureKind.NO_MATCH)}, config)
    assert steps.failure(_BREAK).log_odds(config.view) == 2.0
    usual = np.log(config.view.carried_prior * config.view.unnoticed)
    assert steps.failure(_BREAK + 1).log_odds(config.view) == pytest.approx(usual)


def test_two_key_poses_are_joined_by_one_closure_only(track: Track) -> None:
    poses, last = _poses(track), len(track.keys) - 1
    before, fresh = _closure(track, 0, last, np.zeros(3)), _closure(track, 0, last - 1, np.zeros(3))
    factors = [*_path(track), closure_factor(before)]
    now = _solution(factors, poses, [before]).closed([before, fresh])
    closures = [(factor.i, factor.j) for factor in now.factors if factor.kind == "closure"]
    assert closures == [(0, last), (0, last - 1)]
    assert [attempt.pair for attempt in now.attempts] == closures
