"""Loops: where they are looked for, what is believed, and what a far-off one has to wait for."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Scan
from frontends.simulator.simulation import Simulation, simulate
from graph.config import PoseGraphConfig
from graph.measurement import NoMatch, RelativePose
from graph.noise import chi2_gate
from graph.odometry import OdometryModel, OdometryMotion
from graph.se2 import between, compose, compose_covariance
from iceg.ice.matcher import IceMatcher
from iceg.slam.back_end import BackEnd, solve_track
from iceg.slam.closures.attempt import Attempt, Place, closure_factor
from iceg.slam.closures.candidates import Candidate, EarlierPasses
from iceg.slam.config import FinishConfig, FrontEndConfig, LoopClosureConfig
from iceg.slam.drift import Drift
from iceg.slam.finish import matched_again, refined
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.match_errors import placement_covariance
from iceg.slam.odometry.motions import motions_of
from iceg.slam.rematch import _spaced_keys
from iceg.slam.track import Track
from iceg.slam.tracking.log_tracking import track_log


@pytest.fixture(scope="module")
def office() -> Simulation:
    return simulate("office", seed=1)


@pytest.fixture(scope="module")
def track(office: Simulation) -> Track:
    return track_log(office.log, IceMatcher(), OdometryModel(), FrontEndConfig())


@pytest.fixture(scope="module")
def true_poses(office: Simulation, track: Track) -> NDArray[np.float64]:
    return np.asarray(office.truth[[key.index for key in track.keys]])


def test_drift_of_a_straight_path_has_the_closed_form() -> None:
    # Steps of 1 m along x, position variance p and heading variance q each: after n steps the end is off by
    # n·p + q·Σ (distance left)², the distances being n-1 … 0.
    n, p, q = 20, 1e-4, 1e-5
    drift = Drift()
    for _ in range(n):
        drift.add((np.diag([p, p, q]),), (np.diag([p, p, q]),))
    poses = np.column_stack([np.arange(n + 1.0), np.zeros(n + 1), np.zeros(n + 1)])
    position, heading = drift.spread(n, poses).since(0)
    assert position == pytest.approx((n * p + q * sum(k * k for k in range(n))) ** 0.5)
    assert heading == pytest.approx((n * q) ** 0.5)


def test_a_closure_ends_the_drift_before_it() -> None:
    drift = Drift()
    for _ in range(10):
        drift.add((np.eye(3),), (np.diag([1e-4, 1e-4, 0.0]),))
    poses = np.zeros((11, 3))
    drift.close(6)
    assert drift.spread(10, poses).since(0)[0] == pytest.approx((4 * 1e-4) ** 0.5)
    assert drift.spread(10, poses).since(8)[0] == pytest.approx((2 * 1e-4) ** 0.5)


def test_several_measurements_of_a_step_are_fused_and_the_wider_direction_counts() -> None:
    drift = Drift()
    measured = (np.diag([4e-4, 1e-4, 2e-4]), np.diag([4e-4, 3e-4, 2e-4]))
    drift.add(measured, measured)
    position, heading = drift.spread(1, np.zeros((2, 3))).since(0)
    assert position == pytest.approx(np.sqrt(2e-4))
    assert heading == pytest.approx(np.sqrt(1e-4))


def test_the_covariance_of_a_path_is_that_of_its_steps_seen_from_its_end() -> None:
    # A step that may turn by q, then 3 m straight on: the end is off by 3 m times the turn, across; a turn on the spot
    # before it has no part in it.
    drift = Drift()
    for step in (np.diag([0.0, 0.0, 1.0]), np.diag([1e-4, 2e-4, 1e-4]), np.zeros((3, 3))):
        drift.add((step,), (np.eye(3),))
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [4.0, 0.0, 0.0]])
    expected = [[1e-4, 0.0, 0.0], [0.0, 2e-4 + 9e-4, 3e-4], [0.0, 3e-4, 1e-4]]
    np.testing.assert_allclose(drift.covariance(1, 3, poses), expected, atol=1e-9)


def test_closures_at_true_poses_are_found_and_right(track: Track, true_poses: NDArray[np.float64]) -> None:
    closer = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    deviations, distances, tried = [], [], 0
    for key in range(200, len(track.keys), 7):
        for candidate in closer.passes.within(key, true_poses, np.array([0.1, 0.1, 0.03])):
            attempt = closer.match(candidate, true_poses)
            tried += 1
            if attempt.accepted and attempt.match is not None:
                truth = between(true_poses[attempt.key_old], true_poses[attempt.key_new])
                error = between(truth, attempt.match.T_ref_cur)
                distances.append(np.hypot(error[0], error[1]))
                deviations.append(np.sqrt(error @ np.linalg.solve(attempt.match.covariance, error) / 3.0))
    assert tried > 20
    assert len(distances) > 0.5 * tried
    assert np.median(distances) < 0.01
    assert np.quantile(deviations, 0.9) < 4.0, "a closure that slides along a corridor says so in its covariance"


def test_after_much_drift_the_wide_search_finds_the_place(track: Track, true_poses: NDArray[np.float64]) -> None:
    closer = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    right, found = 0, 0
    for key in range(200, len(track.keys), 12):
        for near in closer.passes.within(key, true_poses, np.array([0.1, 0.1, 0.03]))[:1]:
            astray = compose(near.T_old_new, np.array([1.5, -1.2, 0.3]))
            attempt = closer.match(replace(near, T_old_new=astray, deviations=np.array([1.0, 1.0, 0.2])), true_poses)
            if attempt.accepted and attempt.match is not None:
                error = between(near.T_old_new, attempt.match.T_ref_cur)
                found += 1
                right += bool(np.hypot(error[0], error[1]) < 0.3 and abs(error[2]) < 0.05)
    assert found >= 5
    assert right >= 0.8 * found


def test_a_place_never_seen_is_not_closed(track: Track, true_poses: NDArray[np.float64]) -> None:
    closer = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    rng = np.random.default_rng(0)
    wrong, tried = 0, 0
    for key_new in rng.integers(150, len(track.keys), 25).tolist():
        key_old = int(rng.integers(0, 140))
        apart = np.hypot(*(true_poses[key_old, :2] - true_poses[key_new, :2]))
        if apart < 12.0:
            continue
        claimed = np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(-0.3, 0.3)])
        deviations = np.array([0.3, 0.3, 0.1])
        candidate = Candidate(key_old=key_old, key_new=key_new, T_old_new=claimed, deviations=deviations)
        tried += 1
        wrong += closer.match(candidate, true_poses).accepted
    assert tried >= 8
    assert wrong <= 0.3 * tried, "only similar corridors may pass, and the path must tell them apart"


def _closing_match(track: Track, key_old: int, key_new: int, off: float) -> RelativePose:
    T_old_new = between(track.keys[key_old].T_track_robot, track.keys[key_new].T_track_robot)
    return RelativePose(
        T_ref_cur=compose(T_old_new, np.array([off, 0.0, 0.0])),
        covariance=np.eye(3) * 1e-4,
        score=0.9,
        inliers=150,
        overlap=0.9,
        weak_directions=np.zeros((0, 3)),
    )


class ScriptedCloser(LoopCloser):
    """Finds exactly the closures it was given."""

    def __init__(self, track: Track, config: LoopClosureConfig, script: dict[int, RelativePose]) -> None:
        super().__init__(IceMatcher(), track, config)
        self._script = script

    def candidates(self, key_new: int, poses: NDArray[np.float64], drift: Drift) -> list[Candidate]:
        del drift
        if key_new not in self._script:
            return []
        T_old_new = between(poses[0], poses[key_new])
        return [Candidate(key_old=0, key_new=key_new, T_old_new=T_old_new, deviations=np.array([2.0, 2.0, 0.5]))]

    def match(self, candidate: Candidate, poses: NDArray[np.float64]) -> Attempt:
        del poses
        match = self._script[candidate.key_new]
        return Attempt(key_old=0, key_new=candidate.key_new, match=match, accepted=True, reason="scripted")


def _run_scripted(track: Track, script: dict[int, RelativePose], confirmations: int) -> BackEnd:
    config = LoopClosureConfig(spacing=1e-6, spacing_angle=1e-6, confirmations=confirmations)
    unmatched = [replace(key, match=NoMatch(reason="scripted")) for key in track.keys]
    drifting = replace(track, keys=unmatched)
    back_end = BackEnd(ScriptedCloser(drifting, config, script), PoseGraphConfig())
    motion = OdometryModel().start()
    for key in range(1, 40):
        step = between(track.keys[key - 1].T_track_robot, track.keys[key].T_track_robot)
        covariance = np.diag([2.0 / np.sqrt(30.0), 2.0 / np.sqrt(30.0), 1e-3]) ** 2
        back_end.add(key, OdometryMotion(T_key_robot=step, covariance=covariance, distance=motion.distance))
    return back_end


def test_a_near_closure_enters_at_once(track: Track) -> None:
    back_end = _run_scripted(track, {30: _closing_match(track, 0, 30, 0.05)}, confirmations=3)
    assert sum(factor.kind == "closure" for factor in back_end.graph.factors) == 1


def test_a_far_closure_alone_stays_out_and_says_so(track: Track) -> None:
    solution = _run_scripted(track, {30: _closing_match(track, 0, 30, 1.0)}, confirmations=3).solution()
    assert all(factor.kind != "closure" for factor in solution.factors)
    assert [attempt.accepted for attempt in solution.attempts] == [False]
    assert "alone and far off" in solution.attempts[0].reason


def test_three_far_closures_that_agree_enter_together(track: Track) -> None:
    script = {key: _closing_match(track, 0, key, 1.0) for key in (28, 30, 32)}
    T_old_28 = script[28].T_ref_cur
    for key in (30, 32):
        T_28_key = between(track.keys[28].T_track_robot, track.keys[key].T_track_robot)
        script[key] = replace(script[key], T_ref_cur=compose(T_old_28, T_28_key))
    back_end = _run_scripted(track, script, confirmations=3)
    assert sum(factor.kind == "closure" for factor in back_end.graph.factors) == 3


def test_far_closures_that_agree_with_the_newest_but_not_with_each_other_stay_out(track: Track) -> None:
    T_old_28 = _closing_match(track, 0, 28, 1.0).T_ref_cur
    script = {}
    for key, off in ((28, 0.0), (30, 0.4), (32, 0.2)):  # half of what lies between the first two
        T_28_key = between(track.keys[28].T_track_robot, track.keys[key].T_track_robot)
        T_old_key = compose(compose(T_old_28, np.array([off, 0.0, 0.0])), T_28_key)
        script[key] = replace(_closing_match(track, 0, key, 1.0), T_ref_cur=T_old_key)
    assert _closures(_run_scripted(track, script, confirmations=2)) == 2
    assert _closures(_run_scripted(track, script, confirmations=3)) == 0


def _closures(back_end: BackEnd) -> int:
    return sum(factor.kind == "closure" for factor in back_end.graph.factors)


def test_far_closures_that_contradict_each_other_stay_out(track: Track) -> None:
    script = {28: _closing_match(track, 0, 28, 1.0), 30: _closing_match(track, 0, 30, -1.0)}
    back_end = _run_scripted(track, script, confirmations=2)
    assert all(factor.kind != "closure" for factor in back_end.graph.factors)


def test_only_a_search_that_looked_elsewhere_tells_something_along_what_no_wall_holds() -> None:
    match = RelativePose(
        T_ref_cur=np.array([0.3, 0.0, 0.0]),
        covariance=np.diag([1.0, 1e-4, 1e-6]),
        score=0.9,
        inliers=90,
        overlap=0.9,
        weak_directions=np.array([[1.0, 0.0, 0.0]]),
    )
    near = Attempt(key_old=0, key_new=9, match=match, accepted=True, reason="scripted")
    wide = replace(near, places=(Place(T_old_new=match.T_ref_cur, misfit=0.1),))
    assert np.sqrt(np.diag(closure_factor(near).covariance)) == pytest.approx([10.0, 1e-2, 1e-3], rel=0.01)
    assert np.sqrt(np.diag(closure_factor(wide).covariance)) == pytest.approx([1.0, 1e-2, 1e-3])


@pytest.mark.parametrize(("off", "enters"), [(7.6, True), (8.6, False)])
def test_a_closure_farther_off_than_the_path_can_be_is_refused(track: Track, off: float, enters: bool) -> None:
    solution = _run_scripted(track, {30: _closing_match(track, 0, 30, off)}, confirmations=1).solution()  # ± 2 m
    assert [attempt.accepted for attempt in solution.attempts] == [enters]
    assert ("sigma off the path" in solution.attempts[0].reason) == (not enters)


class TwoAlikePlaces(IceMatcher):
    """Finds what fits twice."""

    def alternatives(
        self,
        reference: Any,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> list[NDArray[np.float64]]:
        best = super().alternatives(reference, scan, T_ref_guess, covariance_guess)[:1]
        return best * 2


def test_a_place_that_fits_twice_is_not_believed(track: Track, true_poses: NDArray[np.float64]) -> None:
    once = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    twice = LoopCloser(TwoAlikePlaces(), track, LoopClosureConfig())
    believed = [key for key in range(60, 200, 10) if once.match_anywhere(key - 3, key, true_poses).accepted]
    assert believed
    attempt = twice.match_anywhere(believed[0] - 3, believed[0], true_poses)
    assert not attempt.accepted
    assert attempt.reason.startswith("2 places fit")


def test_a_closure_errs_with_the_key_pose_it_hangs_on(track: Track, true_poses: NDArray[np.float64]) -> None:
    candidate = Candidate.of(60, 62, true_poses, np.array([0.1, 0.1, 0.03]))
    attempt = LoopCloser(IceMatcher(), track, LoopClosureConfig()).match(candidate, true_poses)
    assert attempt.match is not None
    placed = compose_covariance(placement_covariance(track, 60), attempt.match.T_ref_cur, np.zeros((3, 3)))
    by_the_match = attempt.match.covariance - placed
    assert (np.linalg.eigvalsh(by_the_match) > 0.0).all()
    assert np.trace(placed) > 0.1 * np.trace(by_the_match)


class CrowdedCloser(ScriptedCloser):
    """Finds the scripted closure of a key scan with several earlier key scans at once."""

    times = 3

    def candidates(self, key_new: int, poses: NDArray[np.float64], drift: Drift) -> list[Candidate]:
        return super().candidates(key_new, poses, drift) * self.times


@pytest.mark.parametrize(("passes", "off", "is_confirmed"), [(3, 0.01, True), (2, 0.01, False), (3, 0.2, False)])
def test_an_area_is_confirmed_where_three_passes_agree(
    track: Track, passes: int, off: float, is_confirmed: bool
) -> None:
    closer = CrowdedCloser(track, LoopClosureConfig(), {30: _closing_match(track, 0, 30, off)})
    closer.times = passes
    back_end = BackEnd(closer, PoseGraphConfig())
    for key in range(1, 31):
        back_end._since_search[:] = 0.0
        back_end.add(key, None)
    list(back_end._search(30))
    np.testing.assert_array_equal(np.flatnonzero(~closer.passes.searchable), np.arange(1, 31) if is_confirmed else [])
    key = 30
    while back_end._searched_to == 30:
        key += 1
        back_end.add(key, None)
    since = sum(np.array([step.motion.distance, step.motion.turn]) for step in track.keys[31 : key + 1])
    last = np.array([track.keys[key].motion.distance, track.keys[key].motion.turn])
    limits = np.array([closer.config.spacing, closer.config.spacing_angle]) * (
        closer.config.confirmed.spacing if is_confirmed else 1.0
    )
    assert (since > limits).any()
    assert (since - last <= limits).all(), "not a key scan later"


def test_key_scans_that_only_confirm_are_no_candidates(track: Track, true_poses: NDArray[np.float64]) -> None:
    closer = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    deviations = np.array([0.1, 0.1, 0.03])
    key = next(k for k in range(200, len(track.keys)) if closer.passes.within(k, true_poses, deviations))
    before = closer.passes.within(key, true_poses, deviations)
    nearest = before[0].key_old
    closer.passes.searchable[max(0, nearest - 20) : nearest + 20] = False
    after = closer.passes.within(key, true_poses, deviations)
    assert all(abs(candidate.key_old - nearest) > 4 for candidate in after)
    assert {candidate.key_old for candidate in before[1:]} - {candidate.key_old for candidate in after} <= {
        candidate.key_old for candidate in before if abs(candidate.key_old - nearest) < 24
    }


def test_where_no_pass_is_around_the_nearest_is_looked_at(track: Track, true_poses: NDArray[np.float64]) -> None:
    passes, deviations = LoopCloser(IceMatcher(), track, LoopClosureConfig()).passes, np.array([0.3, 0.3, 0.1])
    key = next(k for k in range(200, len(track.keys)) if passes.within(k, true_poses, deviations))
    first = key - 100
    near = passes.before(first, key, true_poses, deviations, 25.0)
    assert near
    assert all(candidate.key_old < first for candidate in near)
    away = true_poses.copy()
    away[key, :2] += 12.0
    (far,) = passes.before(first, key, away, deviations, 25.0)
    assert far.key_old < first
    assert not passes.before(first, key, away, deviations, 5.0)


def test_the_finish_looks_more_seldom_in_confirmed_areas(track: Track) -> None:
    config, everywhere = FinishConfig(), np.ones(len(track.keys), dtype=np.bool_)
    spacing = LoopClosureConfig().confirmed.spacing
    usual = len(_spaced_keys(track, config, everywhere, spacing))
    seldom = len(_spaced_keys(track, config, ~everywhere, spacing))
    assert 2.0 < usual / seldom < 1.2 * spacing


def test_each_factor_enters_once(track: Track) -> None:
    odometry = np.array([key.T_track_robot for key in track.keys])
    back_end = BackEnd(LoopCloser(IceMatcher(), track, LoopClosureConfig(enabled=False)), PoseGraphConfig())
    for key in range(1, 60):
        step = between(odometry[key - 1], odometry[key])
        back_end.add(key, OdometryMotion(T_key_robot=step, covariance=np.eye(3) * 1e-3))
    matched = sum(not isinstance(key.match, NoMatch) for key in track.keys[1:60])
    kinds = [factor.kind for factor in back_end.graph.factors]
    assert kinds.count("prior") == 1
    assert kinds.count("odometry") == 59
    assert kinds.count("ice") == matched
    assert len(
        set(zip(kinds, [f.i for f in back_end.graph.factors], [f.j for f in back_end.graph.factors], strict=True))
    ) == len(kinds)


def test_a_small_correction_bends_the_path_since_the_last_search(track: Track, true_poses: NDArray[np.float64]) -> None:
    back_end = BackEnd(LoopCloser(IceMatcher(), track, LoopClosureConfig()), PoseGraphConfig())
    for pose in true_poses[1:]:
        back_end._poses.append(pose)
    back_end._searched_to = 40
    offset = np.array([0.03, -0.02, 0.01])
    back_end._correct(44, offset)
    poses = back_end.poses
    np.testing.assert_allclose(between(true_poses[44], poses[44]), offset, atol=1e-12)
    moved = np.hypot(*(poses - true_poses)[:, :2].T)
    np.testing.assert_allclose(moved[40:45], np.arange(5) / 4 * moved[44], atol=1e-12)
    np.testing.assert_array_equal(poses[1:41], true_poses[1:41])
    later = between(true_poses[44], true_poses[45:])
    np.testing.assert_allclose(between(poses[44], poses[45:]), later, atol=1e-12)


def test_odometry_that_jumps_is_given_little_weight(track: Track) -> None:
    back_end = BackEnd(LoopCloser(IceMatcher(), track, LoopClosureConfig(enabled=False)), PoseGraphConfig())
    for key in range(1, 30):
        step = between(track.keys[key - 1].T_track_robot, track.keys[key].T_track_robot)
        jump = np.array([0.0, 0.0, np.radians(30.0) if key == 15 else 0.0])
        back_end.add(key, OdometryMotion(T_key_robot=compose(step, jump), covariance=np.diag([1e-4, 1e-4, 1e-4])))
    solution = back_end.solution()
    assert len(solution.odometry_jumps) == 1
    expected = between(track.keys[0].T_track_robot, track.keys[29].T_track_robot)
    error = between(expected, solution.poses[29])
    assert abs(error[2]) < np.radians(0.5)


@pytest.mark.parametrize("off", [0.1, 0.2, 0.5, 5.0])
def test_odometry_is_no_farther_from_a_sharp_match_than_chance_explains(track: Track, off: float) -> None:
    key = next(k for k, scan in enumerate(track.keys) if isinstance(scan.match, RelativePose))
    match = track.keys[key].match
    assert isinstance(match, RelativePose)
    sharp = replace(match, covariance=np.eye(3) * 1e-12)
    closer = LoopCloser(IceMatcher(), track, LoopClosureConfig(enabled=False))
    back_end, config = BackEnd(closer, PoseGraphConfig()), closer.config.failures
    gate = chi2_gate(config.false_alarm)
    T_track_match = compose(track.keys[track.keys[key].anchor].T_track_robot, match.T_ref_cur)
    step = between(track.keys[key - 1].T_track_robot, T_track_match)
    slipped = OdometryMotion(T_key_robot=compose(step, np.array([off, 0.0, 0.0])), covariance=np.eye(3) * 0.03**2)
    claimed = (off / 0.03) ** 2
    believed = back_end._believed(slipped, sharp, key)
    assert off**2 / believed[0, 0] == pytest.approx(min(claimed, gate), rel=1e-6)
    assert back_end.solution().odometry_jumps == ((key,) if claimed > gate else ())


def test_loops_and_finish_bring_the_office_back_together(
    office: Simulation, track: Track, true_poses: NDArray[np.float64]
) -> None:
    matcher = IceMatcher()
    solution = solve_track(
        LoopCloser(matcher, track, LoopClosureConfig()),
        motions_of(track, office.log.odometry, OdometryModel()),
        PoseGraphConfig(),
    )
    found, rounds = matched_again(solution, track, matcher, LoopClosureConfig(), FinishConfig())
    config = FinishConfig()
    finished = refined(found, rounds, track, matcher, config, scan_of=office.log.scan)

    def worst(poses: NDArray[np.float64]) -> float:
        error = between(true_poses, compose(true_poses[0], poses))
        return float(np.hypot(error[:, 0], error[:, 1]).max())

    assert sum(attempt.accepted for attempt in solution.attempts) > 20
    assert worst(finished.solution.poses) < 0.1
    assert finished.rounds[-1].closures > len([a for a in solution.attempts if a.accepted])


def test_a_search_reaches_as_far_as_drift_and_no_farther(track: Track) -> None:
    config = LoopClosureConfig(max_drift=3.0, max_turn=0.4)
    passes = EarlierPasses(track, config, [])
    little = np.array([config.drift_factor * 0.01 + config.drift_floor] * 2 + [config.drift_factor * 0.02])
    little[2] += config.turn_floor
    np.testing.assert_allclose(passes._search_deviations(np.array([0.01, 0.02])), little)
    np.testing.assert_allclose(passes._search_deviations(np.array([50.0, 50.0])), [3.0, 3.0, 0.4])
