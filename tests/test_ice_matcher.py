"""The matcher as a whole: what it finds, what it refuses, what it claims, and that it does not care where it is."""

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from frontends.simulator.simulation import Simulation, simulate
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between, compose, logmap, wrap_angle
from iceg.ice.config import HypothesisConfig, IceConfig, RefinementConfig
from iceg.ice.hypotheses import SearchWindow, distinct, search_window
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.slam.config import FrontEndConfig
from iceg.slam.tracking.log_tracking import track_log
from tests.walls import see

F64 = NDArray[np.float64]
LOOSE = np.diag([0.1, 0.1, 0.05])


@pytest.fixture(scope="module")
def room() -> Simulation:
    return simulate("room", seed=5)


def reference_at(room: Simulation, matcher: IceMatcher, members: range, T_ref_map: F64) -> LocalMap:
    poses = compose(T_ref_map, room.truth[members])
    return matcher.prepare([room.log.scan(i) for i in members], poses)


def found_pose(match: RelativePose | NoMatch) -> RelativePose:
    assert isinstance(match, RelativePose)
    return match


@pytest.mark.parametrize("search", ["hierarchy", "exhaustive", "genetic", "evolutionary"])
def test_every_search_finds_the_scan_from_half_a_metre_and_thirty_degrees(room: Simulation, search: str) -> None:
    matcher = IceMatcher(IceConfig(hypotheses=HypothesisConfig(search=search)))  # type: ignore[arg-type]
    reference = reference_at(room, matcher, range(0, 60, 6), np.zeros(3))
    true = room.truth[63]
    match = found_pose(matcher.match(reference, room.log.scan(63), true + np.array([0.5, -0.4, 0.5]), LOOSE))
    np.testing.assert_allclose(match.T_ref_cur, true, atol=0.02)
    assert match.score > 0.8
    assert match.is_fully_observed


@pytest.mark.parametrize("fitness", ["points", "probabilistic", "paper"])
@pytest.mark.parametrize("polish", [True, False])
def test_every_fitness_finds_it_with_and_without_the_polish(room: Simulation, fitness: str, polish: bool) -> None:
    config = IceConfig(
        hypotheses=HypothesisConfig(fitness=fitness),  # type: ignore[arg-type]
        refinement=RefinementConfig(enabled=polish),
    )
    matcher = IceMatcher(config)
    reference = reference_at(room, matcher, range(0, 60, 6), np.zeros(3))
    true = room.truth[63]
    match = found_pose(matcher.match(reference, room.log.scan(63), true + np.array([0.4, -0.3, 0.4]), LOOSE))
    np.testing.assert_allclose(match.T_ref_cur, true, atol=0.02 if polish else 0.06)


@pytest.mark.parametrize("T_ref_map", [[3.0, -7.0, 1.0], [0.0, 0.0, np.pi], [-100.0, 50.0, -2.5]])
def test_moving_the_world_and_the_robot_changes_nothing(room: Simulation, T_ref_map: list[float]) -> None:
    frame = np.array(T_ref_map)
    poses = []
    for T in (np.zeros(3), frame):
        matcher = IceMatcher()
        reference = reference_at(room, matcher, range(0, 60, 6), T)
        guess = compose(T, compose(room.truth[63], np.array([0.3, 0.2, 0.3])))
        match = found_pose(matcher.match(reference, room.log.scan(63), guess, LOOSE))
        poses.append(between(T, match.T_ref_cur))
    # The cells of the map lie differently: millimetres.
    np.testing.assert_allclose(poses[0], poses[1], atol=4e-3)


def test_the_same_input_gives_the_same_bytes(room: Simulation) -> None:
    results = []
    for _ in range(2):
        matcher = IceMatcher()
        reference = reference_at(room, matcher, range(0, 60, 6), np.zeros(3))
        match = found_pose(matcher.match(reference, room.log.scan(63), room.truth[63] + [0.3, 0.2, 0.3], LOOSE))
        results.append((match.T_ref_cur.tobytes(), match.covariance.tobytes()))
    assert results[0] == results[1]


def test_extending_a_map_is_building_it(room: Simulation) -> None:
    matcher = IceMatcher()
    built = reference_at(room, matcher, range(0, 60, 6), np.zeros(3))
    extended = reference_at(room, matcher, range(0, 54, 6), np.zeros(3))
    matcher.extend(extended, room.log.scan(54), room.truth[54])
    assert len(extended.surfels) == len(built.surfels)
    np.testing.assert_allclose(np.sort(extended.surfels[:, 0]), np.sort(built.surfels[:, 0]), atol=1e-12)


def test_a_blind_scan_is_no_match(room: Simulation) -> None:
    matcher = IceMatcher()
    reference = reference_at(room, matcher, range(0, 60, 6), np.zeros(3))
    blind = Scan(ranges=np.full(181, np.nan, np.float32), geometry=room.log.geometry)
    blind.ranges[:10] = 2.0
    for answer in (
        matcher.match(reference, blind, room.truth[63], LOOSE),
        matcher.track(reference, blind, room.truth[63], LOOSE),
    ):
        assert isinstance(answer, NoMatch)
        assert answer.reason == "only 10 beams returned, a match needs 15"


def test_another_place_is_no_match(room: Simulation) -> None:
    matcher = IceMatcher()
    reference = reference_at(room, matcher, range(0, 60, 6), np.zeros(3))
    rng = np.random.default_rng(0)
    noise = Scan(ranges=rng.uniform(0.5, 15, 181).astype(np.float32), geometry=room.log.geometry)
    answer = matcher.match(reference, noise, room.truth[63], LOOSE)
    assert isinstance(answer, NoMatch)
    assert "of the beams agree with the local map" in answer.reason


def corridor_scan(x: float) -> Scan:
    """Two endless walls 2 m apart, seen from x with noise."""
    bearings = np.radians(np.arange(-90.0, 91.0))
    with np.errstate(divide="ignore"):
        depth = np.abs(1.0 / np.sin(bearings))
    depth += np.random.default_rng(int(1000 * x)).normal(0, 0.005, 181)
    return Scan(
        ranges=np.where(depth < 10, depth, np.nan).astype(np.float32),
        geometry=ScanGeometry(bearings=bearings, range_min=0.0, range_max=10.0),
    )


def test_along_a_corridor_the_guess_holds_the_scan_and_the_direction_is_weak() -> None:
    matcher = IceMatcher()
    reference = matcher.prepare(
        [corridor_scan(x) for x in (0.0, 0.5, 1.0)], np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]])
    )
    guess = np.array([1.3, 0.02, 0.01])
    match = found_pose(matcher.match(reference, corridor_scan(1.3), guess, np.diag([4e-4, 4e-4, 4e-4])))
    assert match.weak_directions.shape == (1, 3)
    assert abs(match.weak_directions[0] @ [1, 0, 0]) > 0.98
    assert match.T_ref_cur[0] == pytest.approx(1.3, abs=0.05)
    np.testing.assert_allclose(match.T_ref_cur[1:], 0.0, atol=5e-3)


def test_no_pose_far_outside_the_feasible_area(room: Simulation) -> None:
    matcher = IceMatcher()
    reference = reference_at(room, matcher, range(0, 60, 6), np.zeros(3))
    window = SearchWindow(T_ref_guess=room.truth[63] + [0.05, 0.0, 0.0], translation=0.15, rotation=0.1)
    assert window.contains(matcher.align(reference, room.log.scan(63), window).T_ref_cur)


@pytest.mark.parametrize("heading", [1.35, 1.5, 1.65])
def test_round_a_corner_what_the_guess_allows_is_not_given_up_for_the_way_back(heading: float) -> None:
    """Half of the scan is new; turned about, nearly all of it would lie on the corridor that is known."""
    ahead = [[-30, -1, 1, -1], [1, -1, 1, 30], [-30, 1, -12, 1], [-12, 1, -12, 1.3], [-12, 1.3, -11, 1.3]]
    beside = [[-11, 1.3, -11, 1], [-11, 1, -1, 1], [-1, 1, -1, 30], [-30, -1, -30, 1], [-1, 30, 1, 30]]
    walls = np.array([*ahead, *beside])
    matcher, T_map_before = IceMatcher(), np.array([[x, 0.0, 0.0] for x in range(-12, 0)])
    reference = matcher.prepare([see(walls, T, seed=seed) for seed, T in enumerate(T_map_before)], T_map_before)
    T_map_robot = np.array([-0.1, 0.9, heading])
    guess, covariance = T_map_robot + np.array([0.05, -0.1, 0.35]), np.diag([0.06, 0.06, 0.12]) ** 2
    match = found_pose(matcher.match(reference, see(walls, T_map_robot, seed=99), guess, covariance))
    np.testing.assert_allclose(match.T_ref_cur, T_map_robot, atol=0.08)


def test_a_wrong_guess_in_a_small_window_is_found_by_looking_wider(room: Simulation) -> None:
    matcher = IceMatcher()
    reference = reference_at(room, matcher, range(0, 60, 6), np.zeros(3))
    sure = np.diag([1e-4, 1e-4, 1e-4])
    guess = room.truth[63] + [0.6, -0.5, 0.8]
    np.testing.assert_allclose(
        found_pose(matcher.match(reference, room.log.scan(63), guess, sure)).T_ref_cur, room.truth[63], atol=0.02
    )


def factor_nees(scene: str, seed: int) -> tuple[F64, float]:
    """NEES of the matches between consecutive key scans, weak directions left out (scaled to 3), and their share."""
    simulation = simulate(scene, seed=seed)
    track = track_log(simulation.log, IceMatcher(), OdometryModel(), FrontEndConfig())
    values, weak = [], 0
    for a, b in zip(track.keys[:-1], track.keys[1:], strict=True):
        match = b.match
        if isinstance(match, NoMatch):
            continue
        error = logmap(between(match.T_ref_cur, between(simulation.truth[a.index], simulation.truth[b.index])))
        strong = np.eye(3)
        if not match.is_fully_observed:
            weak += 1
            strong = np.linalg.svd(match.weak_directions)[2][len(match.weak_directions) :]
        if len(strong):
            seen = strong @ error
            values.append(3 / len(strong) * seen @ np.linalg.solve(strong @ match.covariance @ strong.T, seen))
    return np.array(values), weak / len(track.keys)


def test_the_covariances_are_right_in_a_room() -> None:
    values, weak = factor_nees("room", 3)
    assert len(values) > 80
    assert 1.5 < values.mean() < 5.0
    assert weak == 0.0


def test_the_covariances_are_right_in_a_corridor_and_its_length_is_weak() -> None:
    values, weak = factor_nees("long_corridor", 3)
    assert len(values) > 100
    assert 1.2 < values.mean() < 5.5
    assert weak > 0.4


def test_matches_without_features_start_from_the_guess_only(room: Simulation) -> None:
    matcher = IceMatcher(IceConfig(use_features=False))
    reference = reference_at(room, matcher, range(0, 60, 6), np.zeros(3))
    hypotheses, _ = matcher.rank(
        reference,
        matcher.observe(room.log.scan(63)),
        SearchWindow(T_ref_guess=np.zeros(3), translation=1.0, rotation=1.0),
    )
    assert hypotheses.tolist() == [[0.0, 0.0, 0.0]]


def test_what_is_remembered_of_scans_is_bounded_and_nothing_depends_on_it(
    room: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    scans = [room.log.scan(k) for k in range(12)]
    roomy, tight = IceMatcher(), IceMatcher()
    expected = [roomy.observe(scan) for scan in scans]
    assert roomy.observe(scans[0]) is expected[0]
    monkeypatch.setattr("iceg.ice.matcher.REMEMBERED", 5)
    for scan, observation in [*zip(scans, expected, strict=True)] * 2:
        found = tight.observe(scan)
        np.testing.assert_array_equal(found.reference_points.points, observation.reference_points.points)
        np.testing.assert_array_equal(found.features.rows, observation.features.rows)
        assert len(tight._observations) <= 5
        assert len(tight._scan_points) <= 5
    assert observation.features.rows.base is None, "no more is kept than there is"


def test_alternatives_are_those_of_the_polish_of_every_leading_hypothesis(room: Simulation) -> None:
    matcher, T_ref_map, covariance = IceMatcher(), np.zeros(3), np.diag([0.6, 0.6, 1.0]) ** 2
    reference = reference_at(room, matcher, range(0, 12, 2), T_ref_map)
    least = matcher.config.refinement.min_inliers
    several = 0
    for index in range(1, 60, 6):
        scan, guess = room.log.scan(index), room.truth[index] + [0.5, -0.4, 0.6]
        window = search_window(guess, covariance, matcher.config.hypotheses)
        hypotheses, ranking = matcher.rank(reference, matcher.observe(scan), window)
        polished = [matcher.refine(reference, scan, hypotheses[k]) for k in distinct(hypotheses, ranking.order, 10)]
        n_points = len(matcher.observe(scan).points)
        expected = [refined.T_ref_cur for refined in polished if refined.inliers >= least * n_points]
        got = matcher.alternatives(reference, scan, guess, covariance)
        several += len(got) > 1
        for poses, others in ((got, expected), (expected, got)):
            for T in poses:
                offsets = np.array([between(T, other) for other in others])
                assert (np.abs(offsets) < [0.25, 0.25, 0.1]).all(axis=1).any()
    assert several >= 1, "the test must try ambiguous places, too"


def test_headings_of_matches_stay_wrapped(room: Simulation) -> None:
    matcher = IceMatcher()
    frame = np.array([0.0, 0.0, np.pi - room.truth[63][2]])
    reference = reference_at(room, matcher, range(0, 60, 6), frame)
    guess = compose(frame, room.truth[63]) + np.array([0.2, 0.1, 0.1])
    guess[2] = wrap_angle(float(guess[2]))
    match = found_pose(matcher.match(reference, room.log.scan(63), guess, LOOSE))
    assert abs(wrap_angle(float(match.T_ref_cur[2] - np.pi))) < 0.01
