"""NDT against its slow twin, finite differences and rooms whose answer is known."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from frontends.matchers import _ndt_kernels as kernels
from frontends.matchers import make_matcher
from frontends.matchers.errors import MatcherError
from frontends.matchers.ndt import NdtConfig, NdtMatcher, sandwich
from frontends.scan import Scan
from graph.measurement import NoMatch, RelativePose
from graph.se2 import between, compose, logmap
from tests.walls import CORRIDOR, GEOMETRY, ROOM, see


def matched(
    matcher: NdtMatcher,
    walls: NDArray[np.float64],
    T_ref_cur: NDArray[np.float64],
    offset: NDArray[np.float64],
    seed: int,
) -> RelativePose | NoMatch:
    reference = matcher.prepare([see(walls, np.zeros(3), seed)], np.zeros((1, 3)))
    guess = compose(T_ref_cur, offset)
    return matcher.match(reference, see(walls, T_ref_cur, seed + 1000), guess, np.diag([0.04, 0.04, 0.01]))


def twin_cells(
    points: NDArray[np.float64], origin: NDArray[np.float64], cell: float, shape: tuple[int, int], ratio: float
) -> NDArray[np.float64]:
    cells = np.zeros((4, *shape, 6))
    for grid in range(4):
        corner = origin - 0.5 * cell * np.array([grid % 2, grid // 2])
        where = np.floor((points - corner) / cell).astype(int)
        for column, row in np.unique(where, axis=0):
            inside = points[(where == (column, row)).all(axis=1)]
            if len(inside) < 3:
                continue
            values, axes = np.linalg.eigh(np.cov(inside.T, bias=True))
            values = np.maximum(values, ratio * values[1])
            inverse = (axes / values) @ axes.T
            cells[grid, row, column] = [*inside.mean(axis=0), inverse[0, 0], inverse[0, 1], inverse[1, 1], 1.0]
    return cells


def test_cells_are_those_of_the_twin() -> None:
    points = see(ROOM, np.array([0.3, 0.2, 0.4])).points
    origin = np.floor(points.min(axis=0))
    columns, rows = (np.floor(points.max(axis=0) - origin).astype(int) + 2).tolist()
    cells = kernels.build_cells(points, origin, 1.0, rows, columns, 3, 0.001)
    expected = twin_cells(points, origin, 1.0, (rows, columns), 0.001)
    assert_array_equal(cells[..., 5], expected[..., 5])
    assert_allclose(cells[..., :2], expected[..., :2], atol=1e-9)
    assert_allclose(cells[..., 2:5], expected[..., 2:5], rtol=1e-5, atol=1e-3)
    assert cells[..., 5].sum() > 40


def test_score_is_the_sum_over_points_and_grids() -> None:
    matcher = NdtMatcher()
    reference = matcher.prepare([see(ROOM, np.zeros(3))], np.zeros((1, 3)))
    points, pose = see(ROOM, np.zeros(3), 1).points, np.array([0.02, -0.01, 0.01])
    c, s = math.cos(pose[2]), math.sin(pose[2])
    expected = 0.0
    for p in points @ np.array([[c, s], [-s, c]]) + pose[:2]:
        for grid in range(4):
            column, row = np.floor((p - reference.origin) + 0.5 * np.array([grid % 2, grid // 2])).astype(int)
            here = reference.cells[grid, row, column]
            if here[5]:
                d = p - here[:2]
                expected += math.exp(-0.5 * d @ np.array([[here[2], here[3]], [here[3], here[4]]]) @ d)
    score = kernels.score_of(points, pose, reference.cells, reference.origin, reference.cell)
    assert score == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("pose", [(0.01, 0.013, 0.003), (0.05, -0.03, 0.02), (-0.1, 0.04, -0.05)])
def test_derivatives_agree_with_finite_differences(pose: tuple[float, float, float]) -> None:
    matcher = NdtMatcher(NdtConfig(eigenvalue_ratio=0.02, coarse_ratio=0.02))
    reference = matcher.prepare([see(ROOM, np.zeros(3))], np.zeros((1, 3)))
    points = see(ROOM, np.zeros(3), 1).points
    here = np.array(pose)

    def fill(at: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        gradients, hessian = np.empty((len(points), 3)), np.empty((3, 3))
        score = kernels.derivatives(points, at, reference.cells, reference.origin, 1.0, gradients, hessian)
        return score, gradients.sum(axis=0), hessian

    _, gradient, hessian = fill(here)
    step = 1e-6
    for i in range(3):
        ahead, behind = here + step * np.eye(3)[i], here - step * np.eye(3)[i]
        up, down = fill(ahead), fill(behind)
        # A point may step over a cell's border in between, where the score is not smooth: hence the tolerance.
        assert gradient[i] == pytest.approx(-(up[0] - down[0]) / (2 * step), rel=2e-2, abs=0.5)
        assert_allclose(hessian[i], (up[1] - down[1]) / (2 * step), rtol=2e-2, atol=0.01 * np.abs(hessian).max())


def test_finds_the_pose_in_a_room() -> None:
    rng = np.random.default_rng(0)
    matcher = NdtMatcher()
    errors = []
    for seed in range(20):
        T_ref_cur = rng.uniform(-1, 1, 3) * np.array([0.3, 0.3, 0.2])
        found = matched(matcher, ROOM, T_ref_cur, rng.uniform(-1, 1, 3) * np.array([0.1, 0.1, 0.08]), seed)
        assert isinstance(found, RelativePose)
        errors.append(logmap(between(found.T_ref_cur, T_ref_cur)))
        assert found.score > 0.8
        assert found.is_fully_observed
    errors_abs = np.abs(errors)
    assert np.median(np.hypot(errors_abs[:, 0], errors_abs[:, 1])) < 0.006
    assert np.median(errors_abs[:, 2]) < 0.002


def test_the_wide_stage_reaches_farther_than_the_paper_alone() -> None:
    rng = np.random.default_rng(1)
    wide, plain = NdtMatcher(), NdtMatcher(NdtConfig(coarse_ratio=0.001))
    successes = np.zeros(2)
    for seed in range(25):
        T_ref_cur = rng.uniform(-1, 1, 3) * np.array([0.3, 0.3, 0.2])
        offset = rng.uniform(-1, 1, 3) * np.array([0.4, 0.4, 0.4])
        for k, matcher in enumerate((wide, plain)):
            found = matched(matcher, ROOM, T_ref_cur, offset, seed)
            if isinstance(found, RelativePose):
                error = np.abs(logmap(between(found.T_ref_cur, T_ref_cur)))
                successes[k] += float(np.hypot(error[0], error[1]) < 0.05 and error[2] < 0.02)
    assert successes[0] >= 20
    assert successes[0] >= successes[1]


def test_covariance_is_of_the_errors_size() -> None:
    rng = np.random.default_rng(2)
    matcher = NdtMatcher()
    nees = []
    for seed in range(40):
        T_ref_cur = rng.uniform(-1, 1, 3) * np.array([0.3, 0.3, 0.2])
        found = matched(matcher, ROOM, T_ref_cur, rng.uniform(-1, 1, 3) * np.array([0.03, 0.03, 0.02]), seed)
        assert isinstance(found, RelativePose)
        assert_array_equal(found.covariance, found.covariance.T)
        assert np.linalg.eigvalsh(found.covariance).min() > 0
        xi = logmap(between(found.T_ref_cur, T_ref_cur))
        nees.append(xi @ np.linalg.solve(found.covariance, xi))
    assert 0.3 < np.median(nees) < 6.0


def test_a_corridor_is_weak_along_itself() -> None:
    T_ref_cur = np.array([0.2, 0.05, 0.1])
    found = matched(NdtMatcher(), CORRIDOR, T_ref_cur, np.array([0.02, 0.02, 0.01]), 0)
    assert isinstance(found, RelativePose)
    assert len(found.weak_directions) == 1
    along = np.array([math.cos(-0.1), math.sin(-0.1), 0.0])
    assert abs(found.weak_directions[0] @ along) > 0.99
    assert along @ found.covariance @ along > 0.5
    across = np.array([-along[1], along[0], 0.0])
    assert across @ found.covariance @ across < 0.05**2


def test_sandwich_in_closed_form() -> None:
    # One parameter per axis: variance b / h².
    covariance = sandwich(np.diag([4.0, 2.0, 1.0]), np.diag([1.0, 1.0, 0.01]), 10.0)
    assert_allclose(covariance, np.diag([1 / 16, 1 / 4, 0.01]), atol=1e-7)
    assert sandwich(np.diag([-1.0, 2.0, 1.0]), np.eye(3), 0.5)[0, 0] == pytest.approx(0.25, rel=1e-6)


def test_covariance_turns_with_the_reference() -> None:
    """The tangent space belongs to the scan: seen from a turned reference the covariance stays the same."""
    matcher = NdtMatcher()
    turned = np.array([0.0, 0.0, 0.0])
    cur = see(CORRIDOR, np.array([0.1, 0.1, 0.3]), 1)
    first = matcher.match(
        matcher.prepare([see(CORRIDOR, turned)], turned[None]), cur, np.array([0.1, 0.1, 0.3]), np.eye(3)
    )
    frame = np.array([0.0, 0.0, np.pi / 2])
    second = matcher.match(
        matcher.prepare([see(CORRIDOR, turned)], frame[None]), cur, compose(frame, np.array([0.1, 0.1, 0.3])), np.eye(3)
    )
    assert isinstance(first, RelativePose)
    assert isinstance(second, RelativePose)
    assert_allclose(first.covariance, second.covariance, rtol=0.3, atol=2e-5)


def test_says_why_it_finds_nothing() -> None:
    matcher = NdtMatcher()
    reference = matcher.prepare([see(ROOM, np.zeros(3))], np.zeros((1, 3)))
    blind = Scan(ranges=np.full(181, np.nan, np.float32), geometry=GEOMETRY)
    nothing = matcher.match(reference, blind, np.zeros(3), np.eye(3))
    assert isinstance(nothing, NoMatch)
    assert "only 0 beams" in nothing.reason
    elsewhere = matcher.match(reference, see(ROOM, np.zeros(3)), np.array([30.0, 0.0, 0.0]), np.eye(3))
    assert isinstance(elsewhere, NoMatch)
    assert "of the beams" in elsewhere.reason
    empty = matcher.prepare([blind], np.zeros((1, 3)))
    assert isinstance(matcher.match(empty, see(ROOM, np.zeros(3)), np.zeros(3), np.eye(3)), NoMatch)


def test_tracking_is_matching_without_covariance_and_both_repeat() -> None:
    matcher = make_matcher("ndt")
    assert isinstance(matcher, NdtMatcher)
    reference = matcher.prepare([see(ROOM, np.zeros(3))], np.zeros((1, 3)))
    scan, guess = see(ROOM, np.array([0.1, 0.0, 0.05]), 1), np.array([0.05, 0.0, 0.0])
    found, again = (matcher.match(reference, scan, guess, np.eye(3)) for _ in range(2))
    assert isinstance(found, RelativePose)
    assert isinstance(again, RelativePose)
    pose = matcher.track(reference, scan, guess, np.eye(3))
    assert not isinstance(pose, NoMatch)
    assert_array_equal(pose, found.T_ref_cur)
    assert_array_equal(again.covariance, found.covariance)


@pytest.mark.parametrize(
    "wrong", [{"cell": 0.0}, {"min_points": 2}, {"eigenvalue_ratio": 0.0}, {"min_inliers": 1.5}, {"iterations": 0}]
)
def test_settings_outside_their_range(wrong: dict[str, float]) -> None:
    with pytest.raises(MatcherError, match="ndt"):
        NdtConfig(**wrong)  # type: ignore[arg-type]
    with pytest.raises(MatcherError, match="at least one scan"):
        NdtMatcher().prepare([], np.empty((0, 3)))
