"""The front end with matchers whose answers are known."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from frontends.scan import Log, Scan, ScanGeometry
from frontends.simulator.simulation import simulate
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between, compose, expmap
from iceg.ice.matcher import IceMatcher
from iceg.ice.verification import Agreement
from iceg.slam.config import FrontEndConfig, KeyScanConfig
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.tracking.front_end import FrontEnd
from iceg.slam.tracking.log_tracking import track_log
from tests.scripted_matcher import ScriptedMatcher
from tests.walls import ROOM, see

_GEOMETRY = ScanGeometry(bearings=np.linspace(-1.5, 1.5, 31), range_min=0.1, range_max=20.0)
_CONFIG = FrontEndConfig(key_scans=KeyScanConfig(distance=0.55, angle=0.5))


def _scan(number: float, value: float = 5.0) -> Scan:
    ranges = np.full(31, value, np.float32)
    ranges[0] = number
    return Scan(ranges=ranges, geometry=_GEOMETRY)


class TruthMatcher(ScriptedMatcher):
    """Knows the true pose of every scan, by the number in its first beam; counts what it is asked."""

    def __init__(self, truth: NDArray[np.float64], fails: frozenset[int] = frozenset()) -> None:
        self.truth = truth
        self.fails = fails
        self.prepared: list[int] = []

    def prepare(self, scans: list[Scan], T_ref_scans: NDArray[np.float64]) -> NDArray[np.float64]:
        self.prepared.append(len(scans))
        return compose(T_ref_scans[-1], _inverse_truth(self.truth[_number(scans[-1])]))

    def match(
        self,
        reference: NDArray[np.float64],
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        del T_ref_guess, covariance_guess
        if _number(scan) in self.fails:
            return NoMatch(reason="told to fail")
        return RelativePose(
            T_ref_cur=compose(reference, self.truth[_number(scan)]),
            covariance=np.eye(3) * 1e-6,
            score=1.0,
            inliers=31,
            overlap=1.0,
            weak_directions=np.zeros((0, 3)),
        )

    def agreement(self, reference: NDArray[np.float64], scan: Scan, T_ref_cur: NDArray[np.float64]) -> Agreement:
        """What is seen agrees where the scan matches; elsewhere it does not, and the scan looks through walls."""
        match = self.match(reference, scan, T_ref_cur, np.eye(3))
        is_there = isinstance(match, RelativePose) and np.allclose(match.T_ref_cur, T_ref_cur, atol=0.05)
        if is_there:
            return Agreement(points=100, known=100, inliers=100, seen=50)
        return Agreement(points=100, known=100, inliers=10, contradicted=40)


def _number(scan: Scan) -> int:
    return round(float(scan.ranges[0]))


def _inverse_truth(T: NDArray[np.float64]) -> NDArray[np.float64]:
    return between(T, np.zeros(3))


def _straight(n: int) -> NDArray[np.float64]:
    return np.column_stack([0.1 * np.arange(n), np.zeros(n), np.zeros(n)])


def _follow(front_end: FrontEnd, odometry: NDArray[np.float64]) -> NDArray[np.float64]:
    steps = between(odometry[:-1], odometry[1:])
    return np.array([front_end.add(i, _scan(i + 1), step) for i, step in enumerate([np.zeros(3), *steps])])


def test_matches_carry_the_robot_whatever_odometry_says() -> None:
    truth = _straight(40)
    matcher = TruthMatcher(np.vstack([np.zeros(3), truth]))
    poses = _follow(FrontEnd(matcher, OdometryModel(), _CONFIG), truth * [1.05, 1.0, 1.0])
    np.testing.assert_allclose(poses, truth, atol=1e-3)


class SlidingMatcher(TruthMatcher):
    """Puts every scan .4 m on along the corridor, which it does not observe: the twist of a ring of 5 m."""

    def match(
        self,
        reference: NDArray[np.float64],
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        match = super().match(reference, scan, T_ref_guess, covariance_guess)
        if isinstance(match, NoMatch):
            return match
        twist = np.array([1.0, 0.0, 0.2])
        weak = twist / np.sqrt(twist @ twist)
        return replace(
            match,
            T_ref_cur=compose(match.T_ref_cur, expmap(0.4 * twist)),
            covariance=match.covariance + np.outer(weak, weak),
            weak_directions=weak[None],
        )


def test_a_match_that_slides_round_a_ring_is_led_back_along_the_ring() -> None:
    truth = np.zeros((41, 3))
    for index in range(40):
        truth[index + 1] = compose(truth[index], expmap(np.array([0.1, 0.0, 0.02])))
    front_end = FrontEnd(SlidingMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    _follow(front_end, truth)
    keys = np.array([key.T_track_robot for key in front_end.keys])
    radii = np.hypot(keys[:, 0], keys[:, 1] - 5.0)
    assert_allclose(radii, 5.0, atol=0.004)


def test_key_scans_come_after_the_configured_distance() -> None:
    truth = _straight(41)
    front_end = FrontEnd(TruthMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    _follow(front_end, truth)
    assert [key.index for key in front_end.keys] == [0, 6, 12, 18, 24, 30, 36]


def test_key_scans_come_after_the_configured_turn() -> None:
    truth = np.column_stack([np.zeros(21), np.zeros(21), 0.11 * np.arange(21)])
    front_end = FrontEnd(TruthMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    _follow(front_end, truth)
    assert [key.index for key in front_end.keys] == [0, 5, 10, 15, 20]


def test_odometry_carries_where_nothing_matches() -> None:
    truth = _straight(30)
    fails = frozenset(range(8, 13))
    front_end = FrontEnd(TruthMatcher(np.vstack([np.zeros(3), truth]), fails), OdometryModel(), _CONFIG)
    poses = _follow(front_end, truth)
    assert front_end.failures == len(fails)
    np.testing.assert_allclose(poses, truth, atol=1e-3)


class BlurredMatcher(TruthMatcher):
    """At some scans it sees one direction only, and puts the robot elsewhere."""

    blurred = range(19, 20)  # a key scan
    error = np.array([1.0, 0.0, 0.5])
    weak_directions = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])

    def match(
        self,
        reference: NDArray[np.float64],
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        match = super().match(reference, scan, T_ref_guess, covariance_guess)
        if isinstance(match, NoMatch) or _number(scan) not in self.blurred:
            return match
        wrong, covariance = compose(match.T_ref_cur, self.error), np.diag([1e-6, 1.0, 1.0])
        return replace(match, T_ref_cur=wrong, covariance=covariance, weak_directions=self.weak_directions)


def test_a_match_that_sees_one_direction_only_does_not_overrule_odometry() -> None:
    truth = _straight(40)
    front_end = FrontEnd(BlurredMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    poses = _follow(front_end, truth)
    np.testing.assert_allclose(poses, truth, atol=1e-3)
    assert [key.index for key in front_end.keys if isinstance(key.match, NoMatch)] == [0, 18]


def test_where_three_key_scans_see_one_direction_only_new_ground_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BlurredMatcher, "blurred", range(19, 37))
    truth = _straight(40)
    front_end = FrontEnd(BlurredMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    _follow(front_end, truth)
    assert front_end.lost


class PeopleMatcher(TruthMatcher):
    """For a few scans it takes people, who walk along, for walls."""

    fooled = range(20, 40)  # among them three key scans

    def match(
        self,
        reference: NDArray[np.float64],
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        match = super().match(reference, scan, T_ref_guess, covariance_guess)
        if isinstance(match, NoMatch) or _number(scan) not in self.fooled:
            return match
        return replace(match, T_ref_cur=compose(match.T_ref_cur, np.array([0.0, 0.4, 0.0])))


@pytest.mark.parametrize(("returns", "distance", "is_fooled"), [(9, 5.0, False), (9, 15.0, True), (31, 5.0, True)])
def test_a_few_beams_close_by_say_nothing_against_odometry(returns: int, distance: float, is_fooled: bool) -> None:
    truth = _straight(50)
    front_end = FrontEnd(PeopleMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    poses = []
    for index in range(50):
        scan = _scan(index + 1, distance)
        if index + 1 in PeopleMatcher.fooled:
            scan.ranges[returns:] = np.nan
        poses.append(front_end.add(index, scan, np.array([0.1, 0.0, 0.0])))
    assert np.allclose(poses, truth, atol=1e-3) != is_fooled
    assert not front_end.lost, "odometry knows the way"


class AliasMatcher(TruthMatcher):
    """One scan matches a wall like the right one, 0.8 m aside, as well as any; `expected` is what it sees in truth."""

    alias = 20
    expected = Agreement()

    def match(
        self,
        reference: NDArray[np.float64],
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        match = super().match(reference, scan, T_ref_guess, covariance_guess)
        if isinstance(match, NoMatch) or _number(scan) != self.alias:
            return match
        return replace(match, T_ref_cur=compose(match.T_ref_cur, np.array([0.0, 0.8, 0.0])))

    def agreement(self, reference: NDArray[np.float64], scan: Scan, T_ref_cur: NDArray[np.float64]) -> Agreement:
        there = super().agreement(reference, scan, T_ref_cur)
        return there if _number(scan) != self.alias or there.inliers == there.known else self.expected


@pytest.mark.parametrize(
    ("expected", "is_believed"),
    [
        (Agreement(points=100, known=40, inliers=40, seen=20), False),
        (Agreement(points=100, known=90, inliers=85, seen=40), False),
        (Agreement(points=100, known=90, inliers=15, contradicted=40), True),
        (Agreement(points=100, known=0), True),
    ],
    ids=["much is new", "it fits there, too", "it looks through walls there", "all is new"],
)
def test_a_match_far_from_odometry_is_believed_only_where_odometry_is_contradicted(
    expected: Agreement, is_believed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(AliasMatcher, "expected", expected)
    truth = _straight(20)
    front_end = FrontEnd(AliasMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    poses = _follow(front_end, truth)
    assert poses[-1, 1] == pytest.approx(0.8 if is_believed else 0.0, abs=1e-3)


@pytest.mark.parametrize(("reach", "wait"), [(0.8, 1.0), (0.1, 8.0), (0.1, 1.0)], ids=["fast", "late", "neither"])
def test_a_match_is_believed_where_the_robot_may_have_got_to(
    reach: float, wait: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where odometry has the robot most is new: that proves a jump, but not that it flew."""
    monkeypatch.setattr(AliasMatcher, "expected", Agreement(points=100, known=20))
    truth = _straight(20)
    front_end = FrontEnd(AliasMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    front_end.expect(np.array([reach, 0.1]))
    steps = [np.zeros(3), *between(truth[:-1], truth[1:])]
    poses = [front_end.add(i, _scan(i + 1), step, wait=wait if i == 19 else 1.0) for i, step in enumerate(steps)]
    assert poses[-1][1] == pytest.approx(0.8 if reach * wait == 0.8 else 0.0, abs=1e-3)


def test_unmatched_key_scans_stay_out_of_the_reference_until_the_robot_is_lost() -> None:
    truth = _straight(60)
    front_end = FrontEnd(
        TruthMatcher(np.vstack([np.zeros(3), truth]), frozenset(range(20, 99))), OdometryModel(), _CONFIG
    )
    _follow(front_end, truth)
    assert front_end.lost, "three key scans in a row without a match begin a new reference"
    assert front_end.lost[0] == 24
    unmatched = [key.index for key in front_end.keys if isinstance(key.match, NoMatch)]
    assert unmatched[1:4] == [24, 30, 36]


def test_a_scan_that_sees_nothing_leaves_it_to_the_next_to_become_a_key_scan() -> None:
    front_end = FrontEnd(TruthMatcher(_straight(60)), OdometryModel(), _CONFIG)
    for index in range(10):
        front_end.add(index, _scan(index, value=0.1 if index == 6 else 5.0), np.array([0.1, 0.0, 0.0]))
    assert [key.index for key in front_end.keys] == [0, 7]


def test_a_covered_laser_is_not_matched_and_not_lost() -> None:
    truth = _straight(60)
    front_end = FrontEnd(TruthMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    for index in range(60):
        covered = 20 <= index < 45
        front_end.add(index, _scan(index + 1, value=0.1 if covered else 5.0), np.array([0.1, 0.0, 0.0]))
    assert front_end.failures == 25
    assert not front_end.lost


@pytest.mark.parametrize("is_lost", [False, True])
def test_a_few_beams_from_afar_are_matched_and_begin_no_new_ground(is_lost: bool) -> None:
    truth, fails = _straight(60), frozenset(range(20, 60)) if is_lost else frozenset[int]()
    front_end = FrontEnd(TruthMatcher(np.vstack([np.zeros(3), truth]), fails), OdometryModel(), _CONFIG)
    geometry = ScanGeometry(bearings=np.linspace(-1.5, 1.5, 361), range_min=0.1, range_max=80.0)
    for index in range(60):
        ranges = np.full(361, np.nan, np.float32)
        ranges[0], ranges[1:30] = index + 1, 25.0
        front_end.add(index, Scan(ranges=ranges, geometry=geometry), np.array([0.1, 0.0, 0.0]))
    assert (front_end.failures > 30) == is_lost
    assert not front_end.lost


class WatchedMatcher(TruthMatcher):
    """Remembers where scans were looked for."""

    def __init__(self, truth: NDArray[np.float64]) -> None:
        super().__init__(truth)
        self.guesses: list[NDArray[np.float64]] = []

    def track(
        self,
        reference: NDArray[np.float64],
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> NDArray[np.float64] | NoMatch:
        self.guesses.append(T_ref_guess)
        return super().track(reference, scan, T_ref_guess, covariance_guess)


def test_a_robot_found_far_off_is_not_looked_for_as_far_again() -> None:
    """It is carried farther than any robot moves in a scan, found there, and stands."""
    truth = np.zeros((7, 3))
    truth[:, 0] = [0.0, 0.0, 0.1, 0.2, 30.0, 30.0, 30.0]  # the first for scan 0, which is not asked for
    matcher = WatchedMatcher(truth)
    front_end = FrontEnd(matcher, None, _CONFIG)
    poses = np.array([front_end.add(k, _scan(k + 1), None) for k in range(6)])
    assert_allclose(poses[:, 0], truth[1:, 0], atol=0.05)
    assert matcher.guesses[2][0] < 1.0
    assert_allclose(matcher.guesses[3], truth[4], atol=1e-6)


class NearMatcher(WatchedMatcher):
    """Finds a scan only where it is looked for within half a metre."""

    def track(
        self,
        reference: NDArray[np.float64],
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> NDArray[np.float64] | NoMatch:
        found = super().track(reference, scan, T_ref_guess, covariance_guess)
        if isinstance(found, NoMatch) or np.allclose(found[:2], T_ref_guess[:2], atol=0.5):
            return found
        return NoMatch(reason="looked for elsewhere")


@pytest.mark.parametrize("intervals", [1, 20], ids=["its scan is stamped late", "it goes on"])
def test_a_robot_without_odometry_is_found_after_a_pause(intervals: int) -> None:
    truth = _straight(20)
    truth[10:, 0] += 0.1 * (intervals - 1)
    matcher = NearMatcher(np.vstack([np.zeros(3), truth]))
    front_end = FrontEnd(matcher, None, _CONFIG)
    poses = [front_end.add(k, _scan(k + 1), None, wait=20.0 if k == 10 else 1.0) for k in range(20)]
    np.testing.assert_allclose(poses, truth, atol=1e-6)
    assert front_end.failures == 0
    np.testing.assert_allclose(matcher.guesses[-9:], truth[11:], atol=0.03)


def test_without_odometry_the_velocity_is_taken_as_constant() -> None:
    truth = _straight(40)
    fails = frozenset(range(20, 25))
    front_end = FrontEnd(TruthMatcher(np.vstack([np.zeros(3), truth]), fails), None, _CONFIG)
    poses = [front_end.add(index, _scan(index + 1), None) for index in range(40)]
    np.testing.assert_allclose(np.array(poses), truth, atol=1e-6)


class CorridorMatcher(TruthMatcher):
    """From a scan on sees nothing along x, where its key scans slide by 0.2 m; between those it takes the guess."""

    entered = 0

    def match(
        self,
        reference: NDArray[np.float64],
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        match = super().match(reference, scan, T_ref_guess, covariance_guess)
        if isinstance(match, NoMatch) or _number(scan) < self.entered:
            return match
        return replace(
            match,
            T_ref_cur=match.T_ref_cur + np.array([0.2, 0.0, 0.0]),
            covariance=np.diag([1.0, 1e-6, 1e-6]),
            weak_directions=np.array([[1.0, 0.0, 0.0]]),
        )

    def track(
        self,
        reference: NDArray[np.float64],
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> NDArray[np.float64] | NoMatch:
        found = super().track(reference, scan, T_ref_guess, covariance_guess)
        return found if _number(scan) < self.entered else T_ref_guess


def test_odometry_speaks_along_a_direction_the_match_cannot_see() -> None:
    truth = _straight(40)
    front_end = FrontEnd(CorridorMatcher(np.vstack([np.zeros(3), truth])), OdometryModel(), _CONFIG)
    poses = _follow(front_end, truth)
    np.testing.assert_allclose(poses[:, 0], truth[:, 0], atol=0.05)


def test_without_odometry_the_velocity_speaks_there() -> None:
    truth = _straight(40)
    corridor = CorridorMatcher(np.vstack([np.zeros(3), truth]))
    corridor.entered = 8
    front_end = FrontEnd(corridor, None, _CONFIG)
    poses = np.array([front_end.add(i, _scan(i + 1), None) for i in range(len(truth))])
    np.testing.assert_allclose(poses[:, 0], truth[:, 0], atol=0.1)


def test_odometry_that_the_match_refutes_says_nothing_along_others_either() -> None:
    truth = _straight(7)
    odometry = truth.copy()
    odometry[6] += [0.6, 0.0, 1.0]  # it jumps where the first key scan comes
    precise = OdometryModel(heading_per_radian=0.03)
    front_end = FrontEnd(CorridorMatcher(np.vstack([np.zeros(3), truth])), precise, _CONFIG)
    poses = _follow(front_end, odometry)
    assert [key.index for key in front_end.keys] == [0, 6]
    np.testing.assert_allclose(poses[6], truth[6] + [0.2, 0.0, 0.0], atol=1e-3)


def test_the_reference_holds_no_more_than_the_window() -> None:
    truth = _straight(200)
    matcher = TruthMatcher(np.vstack([np.zeros(3), truth]))
    config = FrontEndConfig(key_scans=KeyScanConfig(distance=0.5, angle=0.5, window=4))
    _follow(FrontEnd(matcher, OdometryModel(), config), truth)
    assert max(matcher.prepared) == 4


@pytest.fixture(scope="module")
def room() -> tuple[Log, NDArray[np.float64]]:
    simulation = simulate("room", seed=5)
    return simulation.log, simulation.truth


def test_ice_follows_a_robot_through_a_room(room: tuple[Log, NDArray[np.float64]]) -> None:
    log, truth = room
    track = track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())
    poses = track.trajectory(np.array([key.T_track_robot for key in track.keys]))
    error = between(truth, compose(truth[0], poses))
    assert track.failures == 0
    assert np.hypot(error[:, 0], error[:, 1]).max() < 0.05
    assert np.abs(error[:, 2]).max() < 0.02


def test_every_scan_is_tied_to_the_key_scan_before_it(room: tuple[Log, NDArray[np.float64]]) -> None:
    log, _ = room
    track = track_log(log.select(slice(120)), IceMatcher(), OdometryModel(), FrontEndConfig())
    indices = np.array([key.index for key in track.keys])
    np.testing.assert_array_equal(track.key_of_scan, np.searchsorted(indices, np.arange(120), side="right") - 1)
    np.testing.assert_array_equal(track.T_key_scan[indices], np.zeros((len(indices), 3)))


def test_ice_offers_all_that_the_pipeline_can_use() -> None:
    assert isinstance(IceMatcher(), MapMatcher)


@pytest.mark.parametrize(
    ("really", "claimed", "fails", "breaks"),
    [
        (0.1, 3.0, frozenset(), [20]),
        (3.0, 3.0, frozenset(), []),
        (0.1, 3.0, frozenset({21}), [20]),
    ],
    ids=["odometry jumped", "the robot did", "nothing matches"],
)
def test_a_sudden_step_is_believed_where_the_scan_matches(
    really: float, claimed: float, fails: frozenset[int], breaks: list[int]
) -> None:
    truth, odometry = _straight(40), _straight(40)
    truth[20:, 0] += really - 0.1
    odometry[20:, 0] += claimed - 0.1
    front_end = FrontEnd(TruthMatcher(np.vstack([np.zeros(3), truth]), fails), OdometryModel(), _CONFIG)
    steps = between(odometry[:-1], odometry[1:])
    for i, step in enumerate([np.zeros(3), *steps]):
        pose = front_end.add(i, _scan(i + 1), step, is_sudden=i == 20)
    assert front_end.breaks == breaks
    np.testing.assert_allclose(pose, truth[-1], atol=1e-3)


@pytest.mark.parametrize("turn", [np.pi / 2, -np.pi / 2])
def test_a_turn_where_corridors_cross_is_believed_though_all_of_them_are_similar(turn: float) -> None:
    arm = np.array([[1.0, 1.0, 30.0, 1.0], [1.0, -1.0, 30.0, -1.0]])
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
    arms = [(arm.reshape(2, 2, 2) @ np.linalg.matrix_power(quarter, k)).reshape(2, 4) for k in range(4)]
    drive = np.column_stack([np.arange(-12.0, 0.5), np.zeros(13), np.zeros(13)])
    truth = np.vstack([drive, compose(np.array([0.0, 0.0, turn]), np.array([0.3, 0.0, 0.0]))])
    front_end = FrontEnd(IceMatcher(), OdometryModel(), FrontEndConfig())
    steps = between(truth[:-1], truth[1:])
    for index, (step, T) in enumerate(zip([np.zeros(3), *steps], truth, strict=True)):
        is_last = index == len(steps)
        pose = front_end.add(index, see(np.vstack(arms), T, seed=index), step, is_sudden=is_last)
    np.testing.assert_allclose(pose, between(truth[0], truth[-1]), atol=0.05)
    assert not front_end.breaks


@pytest.mark.parametrize("is_late", [True, False])
def test_odometry_that_makes_up_for_what_a_scan_has_shown_leaves_the_robot_where_it_is(is_late: bool) -> None:
    truth = np.column_stack([np.arange(0.0, 1.6, 0.1), np.zeros(16), np.zeros(16)])
    front_end = FrontEnd(IceMatcher(), OdometryModel(), FrontEndConfig())
    for index, T in enumerate(truth):
        front_end.add(index, see(ROOM, T, seed=index), np.array([0.1 * (index > 0), 0.0, 0.0]))
    makes_up = np.array([0.4, -0.6, -1.8])
    pose = front_end.add(16, see(ROOM, truth[-1], seed=16), makes_up, is_late=is_late)
    assert front_end.breaks == ([16] if is_late else [])
    is_found = np.allclose(pose, between(truth[0], truth[-1]), atol=0.05)
    assert is_found == is_late


def test_where_odometry_is_dead_the_velocity_goes_on_and_the_way_is_unknown() -> None:
    truth = _straight(40)
    fails = frozenset({20, 21, 22})
    front_end = FrontEnd(TruthMatcher(np.vstack([np.zeros(3), truth]), fails), OdometryModel(), _CONFIG)
    poses = [front_end.add(i, _scan(i + 1), None if 14 <= i < 30 else np.array([0.1, 0.0, 0.0])) for i in range(40)]
    np.testing.assert_allclose(np.array(poses), truth, atol=1e-6)
    certain, unknown = (next(key for key in front_end.keys if key.index == index) for index in (12, 18))
    assert unknown.motion.covariance[0, 0] > 5 * certain.motion.covariance[0, 0]
    assert not front_end.breaks


def test_a_motion_that_neither_odometry_nor_laser_sees_is_unknown() -> None:
    truth = _straight(60)
    fails = frozenset({*range(20, 23), *range(40, 50)})
    front_end = FrontEnd(TruthMatcher(np.vstack([np.zeros(3), truth]), fails), OdometryModel(), _CONFIG)
    for i in range(60):
        front_end.add(i, _scan(i + 1), None if i >= 14 else np.array([0.1, 0.0, 0.0]))
    assert front_end.unknown_motion == [47]  # five scans after a key scan that was reached in the dark


def test_a_robot_that_looks_once_in_two_metres_is_not_lost() -> None:
    simulation = simulate("corridor", seed=3)
    near = replace(simulation.log, ranges=np.where(simulation.log.ranges < 8.0, simulation.log.ranges, np.nan))
    path = np.cumsum(np.hypot(*np.diff(simulation.truth[:280, :2], axis=0).T))
    seldom = np.searchsorted(path, np.arange(0.0, path[-1], 2.0))
    log = near.select(seldom)
    track = track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())
    assert len(log) > 12
    assert track.failures == 0
