"""Pairs of scans and what is measured on them: starts, success, refusals, honesty, and the rows of the tables."""

from dataclasses import replace
from math import radians
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.matchers.acceptance import AcceptanceConfig
from frontends.matchers.icp import IcpConfig, IcpMatcher
from frontends.matchers.restarts import RestartConfig
from frontends.scan import Scan
from frontends.simulator.simulation import simulate
from graph.measurement import NoMatch, RelativePose
from graph.se2 import between, compose
from iceg.evaluation import paper
from iceg.evaluation.basin import (
    basin,
    named_matcher,
    run_trials,
    search_row,
    starts_at,
    summary_row,
    trials_within,
    uniform_starts,
)
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.relations import read_relations_csv
from iceg.evaluation.scan_pairs import ScanPair, posed_pairs, recorded_pairs, shared_view, simulated_pairs
from iceg.evaluation.trajectory import trajectory_errors
from iceg.ice.config import Search
from iceg.ice.matcher import IceMatcher

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def pairs() -> list[ScanPair]:
    return simulated_pairs("room", 12, seed=1)


class Oracle:
    """Knows the truth of each pair, but only for starts within its reach; its error is drawn from its covariance."""

    def __init__(self, pairs: list[ScanPair], reach: float) -> None:
        self.known = {pair.reference: pair.T_ref_cur for pair in pairs}
        self.reach = reach
        self.rng = np.random.default_rng(0)
        self.covariance = np.diag([0.01, 0.02, 0.005]) ** 2

    def prepare(self, scans: list[Scan], T_ref_scans: Array) -> Any:
        assert len(scans) == len(T_ref_scans) == 1
        return self.known[scans[0]]

    def match(self, reference: Any, scan: Scan, T_ref_guess: Array, covariance_guess: Array) -> RelativePose | NoMatch:
        assert len(scan.points) > 0
        assert (np.linalg.eigvalsh(covariance_guess) > 0).all()
        off = between(reference, T_ref_guess)
        if np.hypot(off[0], off[1]) > self.reach:
            return NoMatch(reason="too far")
        noise = self.rng.multivariate_normal(np.zeros(3), self.covariance)
        return RelativePose(
            T_ref_cur=compose(reference, noise),
            covariance=self.covariance,
            score=1.0,
            inliers=100,
            overlap=1.0,
            weak_directions=np.zeros((0, 3)),
        )


class Stubborn(Oracle):
    """Believes its start."""

    def match(self, reference: Any, scan: Scan, T_ref_guess: Array, covariance_guess: Array) -> RelativePose | NoMatch:
        match = super().match(reference, scan, reference, covariance_guess)
        assert isinstance(match, RelativePose)
        return replace(match, T_ref_cur=T_ref_guess)


def test_pairs_share_their_view_and_their_pose_is_the_truth(pairs: list[ScanPair]) -> None:
    assert len(pairs) == 12
    for pair in pairs:
        assert shared_view(pair) >= 0.5
        moved = replace(pair, T_ref_cur=compose(pair.T_ref_cur, np.array([2.0, 1.5, 0.8])))
        assert shared_view(moved) < shared_view(pair)


def test_too_few_pairs_are_an_error() -> None:
    with pytest.raises(EvaluationError, match="found 0 pairs"):
        simulated_pairs("room", 3, least_shared=1.1)


def test_recorded_pairs_are_two_passes_that_share_their_view(data_dir: Any) -> None:
    relations = read_relations_csv(data_dir / "mit-csail.relations.csv")
    log = read_log(data_dir / "mit-csail.clf.gz")
    pairs = recorded_pairs(log, relations, 5, seed=2)
    assert all(shared_view(pair) >= 0.5 for pair in pairs)
    again = recorded_pairs(log, relations, 5, seed=2)
    np.testing.assert_array_equal([a.T_ref_cur for a in pairs], [b.T_ref_cur for b in again])
    every = recorded_pairs(log, relations, None, seed=2)
    np.testing.assert_array_equal([a.T_ref_cur for a in every[:5]], [b.T_ref_cur for b in pairs])
    assert len(every) > 50
    with pytest.raises(EvaluationError, match=f"found {len(every)} pairs"):
        recorded_pairs(log, relations, len(every) + 1)


def test_posed_pairs_are_two_passes_close_together_with_the_pose_between_them() -> None:
    drive = simulate("office")
    scans = np.arange(0, len(drive.log), 3)
    pairs = posed_pairs(drive.log, scans, drive.truth[scans], 10, seed=1, max_translation=0.8, max_rotation=0.5)
    of_ranges = {drive.log.ranges[k].tobytes(): k for k in scans.tolist()}
    for pair in pairs:
        i, j = of_ranges[pair.reference.ranges.tobytes()], of_ranges[pair.current.ranges.tobytes()]
        assert abs(i - j) > 200
        np.testing.assert_allclose(compose(drive.truth[i], pair.T_ref_cur)[:2], drive.truth[j, :2], atol=1e-9)
        assert np.hypot(*pair.T_ref_cur[:2]) <= 0.8
        assert abs(pair.T_ref_cur[2]) <= 0.5
        assert shared_view(pair) >= 0.5
    again = posed_pairs(drive.log, scans, drive.truth[scans], 10, seed=1, max_translation=0.8, max_rotation=0.5)
    assert [pair.reference.ranges.tobytes() for pair in pairs] == [pair.reference.ranges.tobytes() for pair in again]


def test_poses_of_a_single_pass_make_no_pairs() -> None:
    drive = simulate("office")
    with pytest.raises(EvaluationError, match="100 scans of known poses: found 0 pairs"):
        posed_pairs(drive.log, np.arange(100), drive.truth[:100], 1)
    far_apart = np.array([0, len(drive.log) // 2])
    with pytest.raises(EvaluationError, match="found 0 pairs"):
        posed_pairs(drive.log, far_apart, np.array([[0.0, 0.0, 0.0], [99.0, 0.0, 0.0]]), 1)


def test_starts_are_off_by_what_is_asked(pairs: list[ScanPair]) -> None:
    true = np.array([pair.T_ref_cur for pair in pairs])
    exact = starts_at(pairs, 1.5, radians(60), seed=3) - true
    np.testing.assert_allclose(np.hypot(exact[:, 0], exact[:, 1]), 1.5)
    np.testing.assert_allclose(np.abs(np.remainder(exact[:, 2] + np.pi, 2 * np.pi) - np.pi), radians(60))
    uniform = uniform_starts(pairs, 0.5, 0.2, seed=3) - true
    assert (np.abs(uniform[:, :2]) <= 0.5).all()
    assert (np.abs(uniform[:, 2]) <= 0.2).all()
    assert uniform[:, :2].std() > 0.15


def test_a_matcher_succeeds_as_far_as_it_reaches(pairs: list[ScanPair]) -> None:
    found = basin(Oracle(pairs, reach=1.0), pairs, [0.0, 0.9, 1.1], [0.0, 1.0])
    np.testing.assert_array_equal(found.success, [[1.0, 1.0], [1.0, 1.0], [0.0, 0.0]])
    believed = basin(Stubborn(pairs, reach=1.0), pairs, [0.0, 0.14, 0.16], [0.0, radians(2.9), radians(3.1)])
    np.testing.assert_array_equal(believed.success, [[1, 1, 0], [1, 1, 0], [0, 0, 0]])


def test_what_is_refused_is_not_what_is_wrong(pairs: list[ScanPair]) -> None:
    starts = starts_at(pairs, 1.0, 0.0)
    refused = run_trials(Oracle(pairs, reach=0.5), pairs, starts, 1.0, 0.1)
    assert (refused.success, refused.wrong) == (0.0, 0.0)
    assert np.isnan(refused.errors).all()
    wrong = run_trials(Stubborn(pairs, reach=0.5), pairs, starts, 1.0, 0.1)
    assert (wrong.success, wrong.wrong) == (0.0, 1.0)
    assert np.isfinite(wrong.errors).all()
    assert np.isnan(wrong.median_error_m)
    unsure = replace(wrong, covariances=1e4 * wrong.covariances)
    assert (unsure.success, unsure.wrong) == (0.0, 0.0)
    row = summary_row("stubborn", wrong, wrong)
    assert row["wrong far [%]"] == 100.0


def test_an_honest_matcher_has_a_nees_of_three(pairs: list[ScanPair]) -> None:
    many = pairs * 40
    trials = trials_within(Oracle(pairs, reach=9.0), many, 0.5, 0.3)
    honest = trials.consistency()
    assert honest.mean_low < honest.mean < honest.mean_high
    assert trials.median_error_m == pytest.approx(0.018, rel=0.3)
    assert trials.median_error_rad == pytest.approx(0.6745 * 0.005, rel=0.3)
    proud = replace(trials, covariances=trials.covariances / 100)
    assert proud.consistency().mean == pytest.approx(100 * honest.mean)


def test_every_search_has_a_line_of_the_same_columns(pairs: list[ScanPair]) -> None:
    rows = [
        search_row(search, pairs[:6], [(0.5, radians(20)), (1.0, radians(45))], seed=1) for search in get_args(Search)
    ]
    assert [row["search"] for row in rows] == ["hierarchy", "exhaustive", "genetic", "evolutionary"]
    assert all(row.keys() == rows[0].keys() for row in rows)
    assert (
        rows[0]["±1 m, ±45°: success [%]"] == 100 * trials_within(IceMatcher(), pairs[:6], 1.0, radians(45), 1).success
    )
    assert all(float(row["±0.5 m, ±20°: success [%]"] or 0) > 80 for row in rows)


def test_without_pairs_there_is_nothing_to_match() -> None:
    with pytest.raises(EvaluationError, match="found no pair"):
        trials_within(Oracle([], reach=1.0), [], 0.5, 0.3)


def test_ice_finds_what_a_single_run_of_a_point_matcher_does_not(pairs: list[ScanPair]) -> None:
    once = IcpMatcher(IcpConfig(acceptance=AcceptanceConfig(restarts=RestartConfig(below=0.0))))
    matchers = {"ice": named_matcher("ice"), "icp": once}
    far = {name: trials_within(matcher, pairs, 1.0, radians(60), seed=4) for name, matcher in matchers.items()}
    assert far["ice"].success >= 0.9
    assert far["ice"].success > far["icp"].success
    assert (far["ice"].milliseconds > 0).all()


def test_the_papers_tables_stand_beside_ours() -> None:
    drive = paper.first_scans(simulate("room"), 30)
    assert len(drive.log) == len(drive.truth) == len(drive.log.stamps) == 30
    timed = paper.time_run(drive)
    row = paper.times_row("rooms", timed, replace(timed, cpu_s=3 * timed.cpu_s))
    assert row["ratio"] == pytest.approx(3.0)
    assert row["paper: ratio"] == pytest.approx(2122 / 202)
    assert row["paper: ICE scans/s"] == pytest.approx(10.5, abs=0.1)
    assert paper.quality_row(timed)["ATE [m]"] == timed.errors.ate_rmse < 0.05


def test_errors_along_the_axes_fit_nothing() -> None:
    truth = np.column_stack([np.arange(11.0), np.zeros(11), np.zeros(11)])
    moved = compose(np.array([3.0, -2.0, 1.0]), truth)  # the same path in another frame
    np.testing.assert_allclose(paper.axis_errors(moved, truth).errors, 0.0, atol=1e-12)
    bent = truth + np.column_stack([np.zeros(11), 0.1 * np.arange(11), np.zeros(11)])
    fixed = paper.axis_errors(bent, truth)
    np.testing.assert_allclose(fixed.mean_absolute, [0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(fixed.variance, [0.0, 0.1], atol=1e-12)
    row = paper.axis_row("bent", trajectory_errors(bent, truth), fixed)
    assert row["first pose fixed, y: variance [cm²]"] == pytest.approx(1000.0)
    assert paper.mean_row([row, row]) == row | {"run": "mean of 2"}
