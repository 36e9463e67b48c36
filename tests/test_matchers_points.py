"""The point matchers as matchers: exact recovery, covariances, refusals, the table, real scans."""

import math
import subprocess
import sys
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs.carmen import read_carmen
from frontends.matcher import Matcher
from frontends.matchers import MATCHERS, make_matcher
from frontends.matchers.acceptance import AcceptanceConfig, Alignment, tangent_covariance
from frontends.matchers.bearing_scan import BearingScan
from frontends.matchers.errors import MatcherError
from frontends.matchers.icp import IcpConfig, IcpMatcher
from frontends.matchers.idc import IdcConfig, IdcMatcher
from frontends.matchers.mbicp import MbicpConfig, MbicpMatcher
from frontends.matchers.plicp import PlicpConfig, PlicpMatcher
from frontends.matchers.point_matcher import PointMatcher
from frontends.matchers.qwsm import QwsmConfig, QwsmMatcher
from frontends.matchers.restarts import RestartConfig
from frontends.matchers.weighted import IterationConfig
from frontends.matchers.weighted_points import PointNoiseConfig
from frontends.matchers.wsm import WsmMatcher
from frontends.scan import Log, Scan, ScanGeometry
from frontends.simulator.laser import Laser, sick_lms200
from frontends.simulator.simulation import ScanPairs, scan_pairs
from graph.measurement import NoMatch, RelativePose
from graph.se2 import between, compose, expmap, inverse

NAMES = ("icp", "plicp", "idc", "mbicp", "wsm", "qwsm")
EXACT = Laser(range_std=0.0, range_std_per_metre=0.0, quantisation=0.0, mixed_share=0.0)
LOOSE = np.diag([0.2**2, 0.2**2, 0.3**2])


def point_matcher(name: str) -> PointMatcher[Any, Any]:
    matcher = make_matcher(name)
    assert isinstance(matcher, PointMatcher)
    return matcher


@cache
def exact_pairs() -> ScanPairs:
    return scan_pairs("room", 12, 5, max_translation=0.15, max_rotation=0.15, laser=EXACT)


@cache
def noisy_pairs() -> ScanPairs:
    return scan_pairs("room", 60, 7, max_translation=0.2, max_rotation=0.2)


def scans_of(pairs: ScanPairs, i: int) -> tuple[Scan, Scan]:
    geometry = pairs.geometry
    return Scan(ranges=pairs.reference[i], geometry=geometry), Scan(ranges=pairs.current[i], geometry=geometry)


def matched(matcher: Matcher, pairs: ScanPairs, i: int, T_guess: NDArray[np.float64]) -> RelativePose | NoMatch:
    reference, current = scans_of(pairs, i)
    return matcher.match(matcher.prepare([reference], np.zeros((1, 3))), current, T_guess, LOOSE)


def test_table_holds_every_point_matcher_and_refuses_others() -> None:
    assert set(NAMES) <= set(MATCHERS)
    assert all(isinstance(make_matcher(name), PointMatcher) for name in NAMES)
    with pytest.raises(MatcherError, match="did you mean 'plicp'"):
        make_matcher("plcip")


def test_table_loads_no_kernel() -> None:
    code = "import sys, frontends.matchers; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", NAMES)
def test_a_scan_against_itself_is_found_exactly(name: str) -> None:
    matcher, pairs = make_matcher(name), exact_pairs()
    errors = []
    for i in range(12):
        scan, _ = scans_of(pairs, i)
        twin = Scan(ranges=scan.ranges, geometry=scan.geometry)
        found = matcher.match(matcher.prepare([scan], np.zeros((1, 3))), twin, np.array([0.05, -0.04, 0.05]), LOOSE)
        assert isinstance(found, RelativePose)
        assert found.score > 0.85
        errors.append(np.abs(found.T_ref_cur))
    assert (np.median(errors, axis=0) < 2e-3).all()
    assert (np.max(errors, axis=0) < 0.051).all()


@pytest.mark.parametrize(("name", "metres", "radians"), [
    ("icp", 5e-3, 2e-3), ("plicp", 1e-3, 2e-4), ("idc", 8e-3, 5e-3),
    ("mbicp", 5e-3, 1e-3), ("wsm", 3e-3, 1e-3), ("qwsm", 3e-3, 1e-3),
])  # fmt: skip
def test_noise_free_pairs_are_recovered(name: str, metres: float, radians: float) -> None:
    """To what the sampling of the walls leaves of it: the limits hold in the median, ten times as much at worst."""
    matcher, pairs = make_matcher(name), exact_pairs()
    errors = []
    for i in range(len(pairs.T_ref_cur)):
        found = matched(matcher, pairs, i, np.zeros(3))
        assert isinstance(found, RelativePose)
        error = between(pairs.T_ref_cur[i], found.T_ref_cur)
        errors.append([np.hypot(error[0], error[1]) / metres, abs(error[2]) / radians])
    assert (np.median(errors, axis=0) < 1.0).all()
    assert (np.max(errors, axis=0) < 10.0).all()


@pytest.mark.parametrize("name", NAMES)
def test_result_does_not_depend_on_the_reference_frame(name: str) -> None:
    matcher, pairs = make_matcher(name), noisy_pairs()
    T_map_ref = np.array([12.0, -7.0, 2.5])
    reference, current = scans_of(pairs, 0)
    here = matcher.match(matcher.prepare([reference], np.zeros((1, 3))), current, np.zeros(3), LOOSE)
    there = matcher.match(matcher.prepare([reference], T_map_ref[None]), current, T_map_ref, LOOSE)
    assert isinstance(here, RelativePose)
    assert isinstance(there, RelativePose)
    assert compose(T_map_ref, here.T_ref_cur) == pytest.approx(there.T_ref_cur, abs=1e-6)
    assert here.covariance == pytest.approx(there.covariance, rel=1e-3, abs=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_same_input_same_bytes(name: str) -> None:
    results = []
    for _ in range(2):
        found = matched(make_matcher(name), noisy_pairs(), 3, np.array([0.1, 0.0, 0.1]))
        assert isinstance(found, RelativePose)
        results.append((found.T_ref_cur.tobytes(), found.covariance.tobytes()))
    assert results[0] == results[1]


@pytest.mark.parametrize(("name", "least", "most"), [
    ("icp", 0.8, 5.0), ("plicp", 0.8, 5.0), ("mbicp", 0.8, 5.0), ("idc", 0.8, 8.0), ("wsm", 1.0, 12.0),
    ("qwsm", 1.0, 12.0),
])  # fmt: skip
def test_covariances_are_of_the_right_size(name: str, least: float, most: float) -> None:
    """The median NEES; 2.37 would be perfect."""
    matcher, pairs = make_matcher(name), noisy_pairs()
    nees = []
    for i in range(len(pairs.T_ref_cur)):
        found = matched(matcher, pairs, i, pairs.T_ref_cur[i])
        assert isinstance(found, RelativePose)
        error = between(found.T_ref_cur, pairs.T_ref_cur[i])
        nees.append(float(error @ np.linalg.solve(found.covariance, error)))
    assert least < np.median(nees) < most


@pytest.mark.parametrize("name", NAMES)
def test_covariances_are_symmetric_and_positive_definite(name: str) -> None:
    found = matched(make_matcher(name), noisy_pairs(), 1, np.zeros(3))
    assert isinstance(found, RelativePose)
    assert np.array_equal(found.covariance, found.covariance.T)
    assert np.linalg.eigvalsh(found.covariance)[0] > 0.9 * AcceptanceConfig().min_sigma ** 2
    assert 0.5 < found.score <= found.overlap <= 1.0


def test_covariance_moves_from_the_frame_to_the_tangent_space() -> None:
    """Sampled: exp(ξ)·T with ξ ~ H⁻¹MH⁻¹ is T_robot·exp(η) with η ~ the covariance."""
    T_frame_laser, T_robot_laser = np.array([0.4, -1.2, 0.8]), np.array([0.3, 0.1, -0.5])
    half = np.array([[4e-3, 1e-3, 5e-4], [0.0, 2e-3, -1e-3], [0.0, 0.0, 1.5e-3]])
    hessian = np.linalg.inv(half @ half.T)
    alignment = Alignment(
        T_frame_laser=T_frame_laser, hessian=hessian, scatter=hessian, pairs=100, residual=0.0, iterations=1
    )
    covariance, weak = tangent_covariance(alignment, T_robot_laser, AcceptanceConfig(min_sigma=1e-6))
    draws = np.random.default_rng(0).standard_normal((20000, 3)) @ half.T
    T_laser_robot = inverse(T_robot_laser)
    T_frame_robot = compose(T_frame_laser, T_laser_robot)
    tangents = between(T_frame_robot, compose(compose(expmap(draws), T_frame_laser), T_laser_robot))
    assert len(weak) == 0
    assert np.cov(tangents.T) == pytest.approx(covariance, rel=0.05, abs=0.05 * covariance.max())


def corridor(x: float = 0.0, heading: float = 0.0) -> Scan:
    """A corridor 2 m wide without ends or doors."""
    geometry = replace(sick_lms200(), T_robot_laser=np.zeros(3))
    angles = geometry.bearings + heading
    with np.errstate(divide="ignore"):
        ranges = np.where(np.sin(angles) > 0, 1.0 - x, 1.0 + x) / np.abs(np.sin(angles))
    return Scan(ranges=np.where(ranges < 15.0, ranges, np.nan).astype(np.float32), geometry=geometry)


def test_plicp_says_that_a_corridor_leaves_its_direction_free() -> None:
    matcher = PlicpMatcher()
    found = matcher.match(matcher.prepare([corridor()], np.zeros((1, 3))), corridor(0.05, 0.1), np.zeros(3), LOOSE)
    assert isinstance(found, RelativePose)
    assert found.T_ref_cur[1:] == pytest.approx([0.05, 0.1], abs=2e-3)
    assert found.weak_directions.shape == (1, 3)
    along = np.array([math.cos(-0.1), math.sin(-0.1), 0.0])
    assert abs(found.weak_directions[0] @ along) > 0.99
    assert along @ found.covariance @ along == pytest.approx(1.0, rel=0.05)
    across = np.array([-along[1], along[0], 0.0])
    assert across @ found.covariance @ across < 1e-4


def test_qwsm_sees_what_older_scans_saw() -> None:
    """The newest reference scan looks the other way; only the quad tree over all of them shows the walls again."""
    pairs = exact_pairs()
    reference, current = scans_of(pairs, 2)
    blind = Scan(ranges=np.where(np.arange(181) < 40, reference.ranges, np.nan).astype(np.float32),
                 geometry=reference.geometry)  # fmt: skip
    everything, newest = QwsmMatcher(), QwsmMatcher(QwsmConfig(max_scans=1))
    poses = np.zeros((2, 3))
    found = everything.match(everything.prepare([reference, blind], poses), current, np.zeros(3), LOOSE)
    lost = newest.match(newest.prepare([reference, blind], poses), current, np.zeros(3), LOOSE)
    assert isinstance(found, RelativePose)
    assert between(pairs.T_ref_cur[2], found.T_ref_cur) == pytest.approx(np.zeros(3), abs=5e-3)
    assert isinstance(lost, NoMatch)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_not_credible_is_refused_with_a_reason(name: str) -> None:
    matcher, pairs = make_matcher(name), exact_pairs()
    scan, _ = scans_of(pairs, 0)
    reference = matcher.prepare([scan], np.zeros((1, 3)))
    nothing = Scan(ranges=np.full(181, np.nan, np.float32), geometry=scan.geometry)
    clutter = Scan(ranges=np.random.default_rng(3).uniform(0.5, 15.0, 181).astype(np.float32), geometry=scan.geometry)
    empty = matcher.match(reference, nothing, np.zeros(3), LOOSE)
    foreign = matcher.match(reference, clutter, np.zeros(3), LOOSE)
    far = matcher.match(reference, scan, np.array([40.0, 0.0, 0.0]), LOOSE)
    against_nothing = matcher.match(matcher.prepare([nothing], np.zeros((1, 3))), scan, np.zeros(3), LOOSE)
    assert isinstance(empty, NoMatch)
    assert "only 0 beams of the scan" in empty.reason
    assert isinstance(against_nothing, NoMatch)
    assert "only 0 beams of the reference" in against_nothing.reason
    for refused in (foreign, far):
        assert isinstance(refused, NoMatch)
        assert refused.reason
    with pytest.raises(MatcherError, match="at least one scan"):
        matcher.prepare([], np.zeros((0, 3)))


def test_a_match_far_from_its_guess_is_refused() -> None:
    tight = AcceptanceConfig(max_translation=0.02, max_rotation=0.01, max_sigmas=1.0)
    matcher, pairs = PlicpMatcher(PlicpConfig(acceptance=tight)), exact_pairs()
    refused = [found for i in range(12) if isinstance(found := matched(matcher, pairs, i, np.zeros(3)), NoMatch)]
    assert not refused  # the guess's own standard deviation of 0.2 m allows it
    certain = np.diag([1e-8, 1e-8, 1e-8])
    reference, current = scans_of(pairs, 0)
    found = matcher.match(matcher.prepare([reference], np.zeros((1, 3))), current, np.zeros(3), certain)
    assert isinstance(found, NoMatch)
    assert "from the guess" in found.reason


@pytest.mark.parametrize("name", NAMES)
def test_inliers_are_many_at_the_truth_only(name: str) -> None:
    matcher, pairs = point_matcher(name), noisy_pairs()
    for i in range(5):
        reference, current = scans_of(pairs, i)
        prepared = matcher.prepare([reference], np.zeros((1, 3)))
        right = matcher.inlier_share(prepared, current, pairs.T_ref_cur[i])
        wrong = matcher.inlier_share(prepared, current, compose(pairs.T_ref_cur[i], np.array([0.6, 0.6, 0.5])))
        assert right > 0.9
        assert wrong < 0.6 * right


def test_scans_all_round_match_across_the_seam() -> None:
    """360°: the piece of wall between the last and the first beam is a wall as any other."""
    geometry = ScanGeometry(bearings=np.linspace(-math.pi, math.pi, 360, endpoint=False), range_min=0.1, range_max=30.0)
    pairs = scan_pairs("room", 6, 5, max_translation=0.15, max_rotation=0.4, laser=replace(EXACT, geometry=geometry))
    for name in NAMES:
        matcher = make_matcher(name)
        for i in range(6):
            found = matched(matcher, pairs, i, np.zeros(3))
            assert isinstance(found, RelativePose)
            error = between(pairs.T_ref_cur[i], found.T_ref_cur)
            assert np.hypot(error[0], error[1]) < 0.05
            assert abs(error[2]) < 0.03
    links = BearingScan.of(scans_of(pairs, 0)[0]).links(0.5)
    assert links.mean() > 0.9


@pytest.mark.parametrize("wrong", [
    lambda: IcpConfig(trim=0.0), lambda: PlicpConfig(damping=0.0), lambda: IdcConfig(min_window=2.0),
    lambda: MbicpConfig(length=-1.0), lambda: QwsmConfig(max_scans=0), lambda: IterationConfig(gate=0.0),
    lambda: PointNoiseConfig(range_sigma=0.0), lambda: AcceptanceConfig(min_share=1.5),
])  # fmt: skip
def test_settings_outside_their_range_are_refused(wrong: Any) -> None:
    with pytest.raises(MatcherError, match=r"found|exceeds|need"):
        wrong()


SINGLE_RUN = AcceptanceConfig(restarts=RestartConfig(below=0.0))


@pytest.mark.parametrize(("matcher", "most"), [
    (IcpMatcher(IcpConfig(as_published=True, acceptance=SINGLE_RUN)), 0.058),
    (PlicpMatcher(PlicpConfig(as_published=True, acceptance=SINGLE_RUN)), 0.27),
    (IdcMatcher(IdcConfig(as_published=True, acceptance=SINGLE_RUN)), 0.01),
    (MbicpMatcher(MbicpConfig(as_published=True, acceptance=SINGLE_RUN)), 0.015),
])  # fmt: skip
def test_single_runs_are_as_robust_as_published(matcher: Matcher, most: float, data_dir: Path) -> None:
    """A scan against itself from ±0.2 m, ±45°: ICP 5.8 %, PLICP 24.8 %, IDC 7.3 %, MbICP 0.75 % fail as published."""
    assert failed_against_themselves(matcher, real_log(data_dir / "intel.clf.gz")) < most


@pytest.mark.parametrize(("matcher", "most"), [
    (IcpMatcher(), 0.04), (PlicpMatcher(), 0.08),
    (IdcMatcher(), 0.04), (MbicpMatcher(), 0.04),
    (WsmMatcher(), 0.16), (QwsmMatcher(), 0.08),
])  # fmt: skip
def test_basin_of_real_scans_against_themselves(matcher: Matcher, most: float, data_dir: Path) -> None:
    """The same with the defaults, which leave out pairs at the ends of what the reference saw, and begin again."""
    assert failed_against_themselves(matcher, real_log(data_dir / "intel.clf.gz")) < most


def failed_against_themselves(matcher: Matcher, log: Log, starts: int = 1) -> float:
    """Share of 600 scans, each from so many starts, found beyond 5 cm or 2° of themselves."""
    rng = np.random.default_rng(1)
    failed = 0
    places = np.linspace(0, len(log.ranges) - 1, 600).astype(int).repeat(starts)
    for i in places:
        scan = log.scan(int(i))
        guess = rng.uniform([-0.2, -0.2, -math.pi / 4], [0.2, 0.2, math.pi / 4])
        found = matcher.match(matcher.prepare([scan], np.zeros((1, 3))), scan, guess, LOOSE)
        failed += isinstance(found, NoMatch) or bool(
            np.hypot(*found.T_ref_cur[:2]) > 0.05 or abs(found.T_ref_cur[2]) > math.radians(2)
        )
    return failed / len(places)


@pytest.mark.parametrize("name", NAMES)
def test_real_scans_in_a_row_add_up(name: str, data_dir: Path) -> None:
    """Matches from a to b and from b to c agree with the match from a to c."""
    log, matcher = real_log(data_dir / "intel.clf.gz"), make_matcher(name)
    gaps = []
    for first, second in pairwise(range(400, 700, 12)):
        third = second + 12
        ab, bc, ac = (pair_of(matcher, log, i, j) for i, j in ((first, second), (second, third), (first, third)))
        if not any(isinstance(found, NoMatch) for found in (ab, bc, ac)):
            assert isinstance(ab, RelativePose)
            assert isinstance(bc, RelativePose)
            assert isinstance(ac, RelativePose)
            gaps.append(np.abs(between(ac.T_ref_cur, compose(ab.T_ref_cur, bc.T_ref_cur))))
    assert len(gaps) > 8
    assert np.median(gaps, axis=0) == pytest.approx(np.zeros(3), abs=0.03)


def pair_of(matcher: Matcher, log: Any, i: int, j: int) -> RelativePose | NoMatch:
    guess = between(log.odometry[i], log.odometry[j])
    return matcher.match(matcher.prepare([log.scan(i)], np.zeros((1, 3))), log.scan(j), guess, LOOSE)


@cache
def real_log(path: Path) -> Any:
    return read_carmen(path)
