"""Where match and odometry contradict each other and no closure tells which is right, the run says so."""

import math
from dataclasses import replace

import numpy as np
import pytest

from frontends.scan import Scan, ScanGeometry
from graph.factors import Factor
from graph.measurement import NoMatch
from graph.odometry import OdometryMotion
from iceg.slam.broken_path.conflicts import with_conflicts
from iceg.slam.broken_path.path_break import Break, FailureKind, Outcome, TrackingFailure, describe_break
from iceg.slam.config import LoopClosureConfig
from iceg.slam.solution import Solution
from iceg.slam.track import KeyScan, Track

_KEYS = 200
_CONFIG = LoopClosureConfig()
_SETTLING = _CONFIG.failures.settling_closures


@pytest.fixture(scope="module")
def track() -> Track:
    """A straight way, half a metre from key scan to key scan."""
    motion = OdometryMotion(T_key_robot=np.array([0.5, 0.0, 0.0]), covariance=np.eye(3) * 1e-4, distance=0.5, turn=0.0)
    laser = ScanGeometry(bearings=np.array([0.0, 0.1]), range_min=0.1, range_max=8.0, T_robot_laser=np.zeros(3))
    scan = Scan(ranges=np.full(2, 2.0, dtype=np.float32), geometry=laser)
    keys = [
        KeyScan(
            index=4 * k,
            scan=scan,
            motion=motion,
            match=NoMatch(reason="not looked for"),
            anchor=max(0, k - 1),
            T_track_robot=np.array([0.5 * k, 0.0, 0.0]),
        )
        for k in range(_KEYS)
    ]
    nothing = np.zeros(0, dtype=np.int64)
    return Track(keys=keys, key_of_scan=nothing, T_key_scan=np.zeros((0, 3)), failures=0, lost=[])


def _failure(distance2: float, log_odds: float | None) -> TrackingFailure:
    return TrackingFailure(
        kind=FailureKind.INCONSISTENT,
        reason="the match lies 0.30 m off",
        distance2=distance2,
        log_odds_carried=log_odds,
    )


def _solution(
    track: Track, closures: list[tuple[int, int]], breaks: tuple[Break, ...], jumps: tuple[int, ...] = ()
) -> Solution:
    return Solution(
        factors=[Factor(kind="closure", i=i, j=j, T_i_j=np.zeros(3), covariance=np.eye(3)) for i, j in closures],
        poses=track.T_track_keys,
        attempts=[],
        searchable=np.ones(_KEYS, dtype=np.bool_),
        odometry_jumps=jumps,
        breaks=breaks,
    )


def _told(
    track: Track,
    jumps: dict[int, float],
    closures: list[tuple[int, int]],
    breaks: tuple[Break, ...] = (),
    log_odds: float | None = None,
) -> list[int]:
    before = _solution(track, closures, breaks, tuple(jumps))
    after = with_conflicts(before, track, {key: _failure(far, log_odds) for key, far in jumps.items()}, _CONFIG)
    assert list(after.breaks) == sorted(after.breaks, key=lambda found: found.key)
    return [found.key for found in after.breaks if found.outcome is Outcome.CONFLICT]


def test_a_step_that_nothing_spans_is_told(track: Track) -> None:
    assert _told(track, {100: 40.0}, []) == [100]


def test_what_closures_span_they_have_decided(track: Track) -> None:
    assert _told(track, {100: 40.0}, [(50, 150)]) == []


@pytest.mark.parametrize(
    ("n_closures", "log_odds", "told"),
    [(_SETTLING - 1, 1.0, [100]), (_SETTLING, 1.0, []), (_SETTLING - 1, -4.0, [])],
)
def test_few_closures_settle_nothing_where_the_robot_may_have_been_carried(
    track: Track, n_closures: int, log_odds: float, told: list[int]
) -> None:
    assert _told(track, {100: 40.0}, [(50, 150 + k) for k in range(n_closures)], log_odds=log_odds) == told


def test_of_a_chain_the_worst_is_told_and_each_chain_has_its_own(track: Track) -> None:
    assert _told(track, {60: 40.0, 70: 300.0, 80: 50.0, 150: 30.0}, []) == [70]
    assert _told(track, {60: 40.0, 70: 300.0, 80: 50.0, 150: 30.0}, [(90, 130)]) == [70, 150]


def test_near_the_ends_of_the_path_it_is_told_as_anywhere_else(track: Track) -> None:
    assert _told(track, {2: 40.0, _KEYS - 2: 40.0}, [(50, 150)]) == [2, _KEYS - 2]


def test_a_chain_that_is_told_to_be_broken_is_not_told_again(track: Track) -> None:
    apart = Break(key=80, outcome=Outcome.APART, reason="")
    assert _told(track, {100: 40.0}, [], (apart,)) == []


def test_a_sentence_says_what_the_map_follows(track: Track) -> None:
    told = describe_break(Break(key=100, outcome=Outcome.CONFLICT, reason="the match lies 0.30 m off"), track)
    assert told.kind == "conflict"
    assert told.scan == 400
    assert "before scan 400 (the match lies 0.30 m off)" in told.sentence
    assert "the map follows the match" in told.sentence


def _doubted(
    track: Track,
    log_odds: dict[int, float],
    closures: list[tuple[int, int]],
    breaks: tuple[Break, ...] = (),
) -> dict[int, tuple[Outcome, float]]:
    failures = {
        key: TrackingFailure(kind=FailureKind.NO_MATCH, reason="nothing matched", log_odds_carried=odds)
        for key, odds in log_odds.items()
    }
    after = with_conflicts(_solution(track, closures, breaks), track, failures, _CONFIG)
    return {found.key: (found.outcome, found.probability) for found in after.breaks}


def test_who_may_have_been_carried_is_told_with_its_probability(track: Track) -> None:
    outcome, probability = _doubted(track, {100: -1.0}, [])[100]
    assert outcome is Outcome.DOUBTFUL
    assert probability == pytest.approx(1.0 / (1.0 + math.e))


def test_an_idle_doubt_is_not_told(track: Track) -> None:
    least = np.log(_CONFIG.failures.doubt / (1.0 - _CONFIG.failures.doubt))
    assert _doubted(track, {100: least - 1e-6, 150: least + 1e-6}, []).keys() == {150}


def test_closures_across_settle_a_doubt_where_they_are_many(track: Track) -> None:
    across = [(50, 150 + k) for k in range(_SETTLING)]
    assert _doubted(track, {100: -1.0}, across) == {}
    assert _doubted(track, {100: -1.0}, across[1:]).keys() == {100}


def test_failures_that_saw_one_change_of_the_view_are_one_doubt(track: Track) -> None:
    near = _CONFIG.view.keys
    told = _doubted(track, {100: -2.0, 100 + near: -0.5, 120: -1.0}, [])
    assert told.keys() == {100, 120}
    assert told[100][1] == pytest.approx(1.0 / (1.0 + np.exp(0.5)))


@pytest.mark.parametrize(("outcome", "is_doubted"), [(Outcome.JOINED, False), (Outcome.APART, True)])
def test_a_break_that_closures_join_is_no_doubt(track: Track, outcome: Outcome, *, is_doubted: bool) -> None:
    known = Break(key=100, outcome=outcome, reason="")
    told, probability = _doubted(track, {100: -1.0}, [], (known,))[100]
    assert told is outcome
    assert (probability > 0.0) is is_doubted


def test_a_doubt_is_told_with_its_probability(track: Track) -> None:
    doubt = Break(key=100, outcome=Outcome.DOUBTFUL, reason="nothing matched", probability=0.38)
    told = describe_break(doubt, track)
    assert told.kind == "doubtful"
    assert "may have been carried before scan 400 (nothing matched)" in told.sentence
    assert "38% probable" in told.sentence


@pytest.mark.parametrize(
    ("outcome", "words"),
    [
        (Outcome.JOINED, "right with a probability of 62%"),
        (Outcome.DRIFTED, "right with a probability of 62%"),
        (Outcome.CONFLICT, "which is 38% probable"),
    ],
)
def test_a_break_that_may_be_wrong_is_told_with_its_probability(track: Track, outcome: Outcome, words: str) -> None:
    sure = Break(key=100, outcome=outcome, reason="nothing matched", closures=9, moved=12.0)
    assert "%" not in describe_break(sure, track).sentence
    assert words in describe_break(replace(sure, probability=0.38), track).sentence
