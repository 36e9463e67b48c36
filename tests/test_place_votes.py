"""Perceptual aliasing: which of them a row of key scans speaks for, and where nothing decides."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.simulator.simulation import simulate
from graph.config import PoseGraphConfig
from graph.measurement import RelativePose
from graph.odometry import OdometryModel, OdometryMotion
from graph.se2 import between, compose
from iceg.ice.matcher import IceMatcher
from iceg.slam.back_end import BackEnd
from iceg.slam.broken_path.place_votes import PlaceVotes, Vote, describe_vote, unsettled
from iceg.slam.closure_config import PlaceVotesConfig, VerificationConfig
from iceg.slam.closures.attempt import Attempt, Place
from iceg.slam.closures.candidates import Candidate
from iceg.slam.closures.closure import best_rival
from iceg.slam.config import FinishConfig, FrontEndConfig, LoopClosureConfig
from iceg.slam.drift import Drift
from iceg.slam.finish import matched_again
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.solution import Solution
from iceg.slam.track import Track
from iceg.slam.tracking.log_tracking import track_log

Array = NDArray[np.float64]

_PATH = np.column_stack([0.5 * np.arange(120), np.zeros(120), np.zeros(120)])
"""Along a straight corridor; key poses from 60 on see again what those from 0 on saw."""


def _match(T_old_new: Array, weak: Array | None = None) -> RelativePose:
    return RelativePose(
        T_ref_cur=T_old_new,
        covariance=np.eye(3) * 1e-4,
        score=0.9,
        inliers=150,
        overlap=0.9,
        weak_directions=np.zeros((0, 3)) if weak is None else weak,
    )


def _attempt(key_new: int, poses: Array, shifts: dict[float, float], key_old: int = 0) -> Attempt:
    """One whose later end fits so many metres farther along than the path has it, each with its misfit."""
    T_old_new = between(poses[key_old], poses[key_new])
    places = tuple(Place(T_old_new=T_old_new + np.array([shift, 0, 0]), misfit=m) for shift, m in shifts.items())
    match = _match(places[0].T_old_new)
    return Attempt(
        key_old=key_old, key_new=key_new, match=match, accepted=len(places) == 1, reason="scripted", places=places
    )


def _voted(each: list[dict[float, float]]) -> Vote:
    """What speaks for the first place of the last of key scans 60, 62, …; an empty one was looked for in vain."""
    votes, attempt = PlaceVotes(LoopClosureConfig()), None
    for key, shifts in enumerate(each):
        attempt = _attempt(60 + 2 * key, _PATH, shifts or {0.0: 0.0})
        votes.add(attempt if shifts else replace(attempt, match=None, places=()))
    assert attempt is not None
    return votes.of(attempt, _PATH)


def test_a_place_that_all_fit_and_no_other_is_clear() -> None:
    vote = _voted([{5.0: 0.02}] * 7)
    assert (vote.first, vote.last, vote.count, vote.rival) == (60, 72, 7, 0)
    assert vote.is_clear
    assert vote.is_strong(PlaceVotesConfig())


def test_of_two_places_that_fit_as_well_none_is_believed() -> None:
    vote = _voted([{0.0: 0.02, 6.0: 0.03}] * 10)
    assert (vote.count, vote.rival) == (10, 10)
    assert vote.apart == pytest.approx(6.0)
    assert not vote.is_clear


def test_a_search_that_finds_one_place_by_chance_is_overruled_by_its_neighbours() -> None:
    # All others fit one door on, too; of the last search the reference ended there.
    equal = [{0.0: 0.02, 6.0: 0.02}] * 5
    assert not _voted([*equal, {0.0: 0.02, 6.0: 0.03}]).is_clear
    votes = PlaceVotes(LoopClosureConfig())
    for key in range(60, 72, 2):
        votes.add(_attempt(key, _PATH, {0.0: 0.02, 6.0: 0.02}))
    alone = _attempt(72, _PATH, {0.0: 0.02})
    votes.add(alone)
    votes.add(_attempt(72, _PATH, {6.0: 0.02}, key_old=4))  # another piece of the pass holds the next door
    assert not votes.of(alone, _PATH).is_clear


@pytest.mark.parametrize(("searches", "worse", "is_strong"), [(6, 0.1, True), (5, 0.1, False), (6, 0.03, False)])
def test_many_key_scans_that_fit_one_place_better_decide(searches: int, worse: float, is_strong: bool) -> None:
    assert _voted([{0.0: 0.02, 6.0: 0.02 + worse}] * searches).is_strong(PlaceVotesConfig()) == is_strong


def test_a_better_fit_does_not_decide_while_others_fit_the_other_place_alone() -> None:
    both, other = {0.0: 0.02, 6.0: 0.15}, {6.0: 0.15}
    assert _voted([both, both, *[other] * 2, *[both] * 5]).is_clear
    assert not _voted([both, both, *[other] * 4, *[both] * 5]).is_clear


def test_a_vote_is_not_strong_where_most_searches_fail_or_all_fit_badly() -> None:
    fits = {0.0: 0.05}
    assert _voted([*[{}] * 3, *[fits] * 6]).is_strong(PlaceVotesConfig())
    assert _voted([fits, *[{}] * 6, *[fits] * 6]).is_strong(PlaceVotesConfig())
    assert not _voted([fits, *[{}] * 8, *[fits] * 5]).is_strong(PlaceVotesConfig())
    assert not _voted([{0.0: 0.2}] * 8).is_strong(PlaceVotesConfig())


def test_places_that_the_path_between_contradicts_are_different_ones() -> None:
    assert _voted([{0.0: 0.02}, {0.5: 0.02}, {1.0: 0.02}]).count == 1


def test_long_ago_does_not_count() -> None:
    votes = PlaceVotes(LoopClosureConfig())
    votes.add(_attempt(10, _PATH, {6.0: 0.02}))
    newest = _attempt(110, _PATH, {6.0: 0.02})
    votes.add(newest)
    assert votes.of(newest, _PATH).count == 1


def test_a_closure_across_settles_a_vote() -> None:
    vote = Vote(first=70, last=90, count=9, rival=8, apart=6.0)
    before, across = _attempt(60, _PATH, {0.0: 0.0}), _attempt(95, _PATH, {0.0: 0.0})
    assert unsettled([vote], [before, replace(across, accepted=False)]) == (vote,)
    assert unsettled([vote], [before, across]) == ()


@pytest.fixture(scope="module")
def track() -> Track:
    log = simulate("office", seed=1).log
    return track_log(log.select(slice(1800)), IceMatcher(), OdometryModel(), FrontEndConfig())


class _Closer(LoopCloser):
    """Finds the places it was given in wide searches."""

    def __init__(self, track: Track, config: LoopClosureConfig, script: dict[int, Attempt]) -> None:
        super().__init__(IceMatcher(), track, config)
        self._script = script

    def candidates(self, key_new: int, poses: Array, drift: Drift) -> list[Candidate]:
        del drift
        found = self._script.get(key_new)
        return [] if found is None else [Candidate.of(found.key_old, key_new, poses, np.array([4.0, 4.0, 0.5]))]

    def match(self, candidate: Candidate, poses: Array) -> Attempt:
        return self._script.get(candidate.key_new) or super().match(candidate, poses)


def _solved(track: Track, script: dict[int, Attempt]) -> BackEnd:
    config = LoopClosureConfig(spacing=1e-6, spacing_angle=1e-6)
    back_end = BackEnd(_Closer(track, config, script), PoseGraphConfig())
    for key in range(1, len(track.keys)):
        step = between(track.keys[key - 1].T_track_robot, track.keys[key].T_track_robot)
        covariance = np.diag([0.05, 0.05, 0.02]) ** 2
        back_end.add(key, OdometryMotion(T_key_robot=step, covariance=covariance, distance=0.5))
    return back_end


def _poses(track: Track) -> Array:
    return np.array([key.T_track_robot for key in track.keys])


_FAR, _DOOR = 1.5, 6.0
_SEEN_AGAIN = range(40, 60, 2)


def _script(track: Track, *, misfit_elsewhere: float) -> dict[int, Attempt]:
    """Key scans that fit where the path has drifted to within 1.5 m of, and one door on."""
    poses, key_old = _poses(track), 0
    script = {}
    for key in _SEEN_AGAIN:
        drifted = compose(np.array([_FAR, 0.0, 0.0]), poses[key])
        next_door = compose(np.array([_FAR + _DOOR, 0.0, 0.0]), poses[key])
        places = tuple(
            Place(T_old_new=between(poses[key_old], T), misfit=misfit)
            for T, misfit in ((drifted, 0.02), (next_door, misfit_elsewhere))
        )
        script[key] = Attempt(
            key_old=key_old,
            key_new=key,
            match=_match(places[0].T_old_new),
            accepted=False,
            reason="2 places fit; scripted",
            places=places,
        )
    return script


def _closures(solution: Solution) -> int:
    return sum(factor.kind == "closure" for factor in solution.factors)


def test_where_two_rows_of_places_are_about_as_strong_nothing_is_closed_and_it_is_said(track: Track) -> None:
    solution = _solved(track, _script(track, misfit_elsewhere=0.03)).solution()
    assert _closures(solution) == 0
    assert not any(attempt.accepted for attempt in solution.attempts)
    assert all(attempt.reason.startswith("perceptual aliasing") for attempt in solution.attempts)
    (vote,) = solution.ambiguous
    assert (vote.first, vote.last) == (_SEEN_AGAIN[0], _SEEN_AGAIN[-1])
    assert vote.rival == vote.count == len(_SEEN_AGAIN)
    said = describe_vote(vote, track).sentence
    assert f"from scan {track.keys[40].index} to {track.keys[58].index}" in said
    assert "6.0 m away" in said


def test_a_row_that_fits_one_place_better_closes_what_single_searches_left_open(track: Track) -> None:
    solution = _solved(track, _script(track, misfit_elsewhere=0.15)).solution()
    assert solution.ambiguous == ()
    accepted = [attempt for attempt in solution.attempts if attempt.accepted]
    assert len(accepted) == _closures(solution) >= len(_SEEN_AGAIN) - 1
    assert all(attempt.reason.startswith("here its neighbours fit best; 2 places") for attempt in accepted)


def test_a_match_near_the_path_waits_too_where_another_place_fits_as_well(track: Track) -> None:
    poses, script = _poses(track), {}
    for key in _SEEN_AGAIN:
        here, next_door = (compose(np.array([shift, 0.0, 0.0]), poses[key]) for shift in (0.1, _DOOR))
        places = tuple(Place(T_old_new=between(poses[0], T), misfit=0.02) for T in (here, next_door))
        script[key] = Attempt(
            key_old=0, key_new=key, match=_match(places[0].T_old_new), accepted=True, reason="scripted", places=places
        )
    assert _closures(_solved(track, script).solution()) == 0
    alone = {key: replace(attempt, places=attempt.places[:1]) for key, attempt in script.items()}
    assert _closures(_solved(track, alone).solution()) == len(_SEEN_AGAIN)


@pytest.mark.parametrize("is_weak", [False, True])
def test_what_no_closure_holds_goes_on_drifting(track: Track, is_weak: bool) -> None:
    # Along a corridor a match slides to where the path puts it: that it lies there says nothing.
    key = 40
    near = _attempt(key, _poses(track), {0.0: 0.0})
    assert near.match is not None
    weak = np.array([[1.0, 0.0, 0.0]]) if is_weak else np.zeros((0, 3))
    back_end = _solved(track, {key: replace(near, match=replace(near.match, weak_directions=weak))})
    assert _closures(back_end.solution()) == 1
    poses = _poses(track)
    before, after = (back_end._drift.spread(len(poses) - 1, poses).since(old)[0] for old in (key, 0))
    assert (after > before) == is_weak


def test_after_much_drift_a_match_near_the_path_asks_what_else_fits(track: Track) -> None:
    poses = _poses(track)
    closer = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    near = closer.match(Candidate.of(60, 62, poses, np.array([0.1, 0.1, 0.03])), poses)
    wide = closer.match(Candidate.of(60, 62, poses, np.array([2.0, 2.0, 0.1])), poses)
    assert near.accepted
    assert near.places == ()
    assert wide.accepted
    assert wide.match is not None
    np.testing.assert_array_equal(wide.places[0].T_old_new, wide.match.T_ref_cur)
    assert 0.0 <= wide.places[0].misfit < 0.4
    assert len(wide.places) >= 2, "what the wide search found"


def test_the_finish_closes_nothing_across_what_is_ambiguous(track: Track) -> None:
    back_end = _solved(track, {})
    plain = back_end.solution()
    middle = 200
    ambiguous = replace(plain, ambiguous=(Vote(first=middle, last=middle + 5, count=6, rival=6, apart=6.0),))
    matcher = IceMatcher()

    def across(solution: Solution) -> int:
        config = FinishConfig(rounds=1)
        done, _ = matched_again(solution, track, matcher, LoopClosureConfig(), config)
        return sum(attempt.key_old < middle <= attempt.key_new for attempt in done.attempts)

    assert across(plain) > 0
    assert across(ambiguous) == 0


def test_the_best_other_place_is_the_rival_of_a_closure() -> None:
    attempt = _attempt(60, _PATH, {0.0: 0.05, 0.1: 0.04, 3.0: 0.3, 2.0: 0.2})
    rival = best_rival(attempt, VerificationConfig().place)
    assert rival is not None
    assert (rival.own, rival.misfit) == (0.04, 0.2)
    assert rival.apart == pytest.approx(2.0)
    assert best_rival(_attempt(60, _PATH, {0.0: 0.05, 0.1: 0.04}), VerificationConfig().place) is None
