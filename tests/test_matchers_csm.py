"""Correlative matching: table, bounds, branch and bound against an exhaustive search, and rooms with a known answer."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from frontends.matchers import _csm_kernels as kernels
from frontends.matchers import make_matcher
from frontends.matchers.csm import CsmConfig, CsmMatcher, LikelihoodTable
from frontends.matchers.errors import MatcherError
from frontends.matchers.surfaces import weak_directions
from frontends.scan import Scan
from graph.measurement import NoMatch, RelativePose
from graph.se2 import between, compose, logmap, transform_points
from tests.walls import CORRIDOR, GEOMETRY, ROOM, see


def tables(max_side: int = 40) -> st.SearchStrategy[NDArray[np.uint8]]:
    def build(rows: int, columns: int, seed: int, share: float) -> NDArray[np.uint8]:
        rng = np.random.default_rng(seed)
        values = rng.integers(0, 256, (rows, columns))
        return np.where(rng.random((rows, columns)) < share, values, 0).astype(np.uint8)

    return st.builds(
        build, st.integers(3, max_side), st.integers(3, max_side), st.integers(0, 10_000), st.floats(0.02, 1.0)
    )


def pyramid_of(table: NDArray[np.uint8], levels: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    return LikelihoodTable(table=table, origin=np.zeros(2), cell=1.0).pyramid(levels)


def test_table_is_the_likelihood_of_the_nearest_point() -> None:
    points = np.array([[0.5, 0.5], [0.95, 0.62], [1.4, 1.1]])
    table = np.zeros((20, 20), np.uint8)
    kernels.render_table(points, np.zeros(2), 0.1, 0.3, table)
    centres = (np.arange(20) + 0.5) * 0.1
    distance2 = np.min([(centres[None, :] - x) ** 2 + (centres[:, None] - y) ** 2 for x, y in points], axis=0)
    expected = np.maximum(np.floor(255 * (1.0 - distance2 / 0.09) + 0.5), 0.0)
    assert_allclose(table.astype(float), expected, atol=1.0)


@given(table=tables(), level=st.integers(1, 4), row=st.integers(-9, 45), column=st.integers(-9, 45))
def test_every_level_bounds_the_block_it_stands_for(
    table: NDArray[np.uint8], level: int, row: int, column: int
) -> None:
    pyramid, layout = pyramid_of(table, level)
    start, rows, columns = layout[level - 1].tolist()
    bounds = pyramid[start : start + rows * columns].reshape(rows, columns)
    r, c = (row >> level) + 1, (column >> level) + 1
    bound = int(bounds[r, c]) if 0 <= r < rows and 0 <= c < columns else 0
    width = 1 << level
    block = table[max(row, 0) : max(row + width, 0), max(column, 0) : max(column + width, 0)]
    assert bound >= block.max(initial=0)


@settings(max_examples=80)
@given(
    table=tables(),
    n_points=st.integers(1, 12),
    n_turns=st.integers(1, 5),
    span=st.integers(1, 9),
    levels=st.integers(1, 4),
    seed=st.integers(0, 10_000),
)
def test_branch_and_bound_finds_what_an_exhaustive_search_finds(
    table: NDArray[np.uint8], n_points: int, n_turns: int, span: int, levels: int, seed: int
) -> None:
    cells = np.random.default_rng(seed).integers(-5, 45, (n_turns, n_points, 2)).astype(np.int32)
    total, turn, dr, dc, scored = kernels.branch_and_bound(cells, span, table, *pyramid_of(table, levels), -1)
    expected, *_ = kernels.exhaustive(cells, span, table)
    assert total == expected
    assert max(abs(dr), abs(dc)) <= span
    assert scored >= 1
    rows, columns = (cells[turn] + (dr, dc)).T
    inside = (rows >= 0) & (columns >= 0) & (rows < table.shape[0]) & (columns < table.shape[1])
    assert table[rows[inside], columns[inside]].astype(int).sum() == total


def test_branch_and_bound_looks_at_few_candidates() -> None:
    matcher = CsmMatcher()
    reference = matcher.prepare([see(ROOM, np.zeros(3))], np.zeros((1, 3)))
    points = see(ROOM, np.array([0.2, 0.1, 0.1]), 1).points
    turns = np.linspace(-0.5, 0.5, 101)
    cells = kernels.turned_cells(points, np.zeros(3), turns, reference.origin, reference.cell)
    *_, scored = kernels.branch_and_bound(cells, 32, reference.table, *reference.pyramid(5), -1)
    assert scored < 0.05 * 101 * 65 * 65


def test_contours_join_what_is_near_and_nothing_else() -> None:
    points = np.array([[0.0, 0.0], [0.2, 0.0], [1.2, 0.0], [1.2, 0.1]])
    filled = kernels.contours(points, 0.5, 0.05)
    assert_array_equal(kernels.contours(points, 0.0, 0.05), points)
    for point in points:
        assert np.abs(filled - point).sum(axis=1).min() == 0.0
    between_them = filled[(filled[:, 0] > 0.2 + 1e-9) & (filled[:, 0] < 1.2 - 1e-9)]
    assert len(between_them) == 0
    assert np.diff(np.sort(filled[filled[:, 0] <= 0.2, 0])).max() <= 0.05 + 1e-9


def test_finds_the_pose_from_far_off() -> None:
    rng = np.random.default_rng(0)
    matcher = CsmMatcher()
    found_all = 0
    for seed in range(12):
        T_ref_cur = rng.uniform(-1, 1, 3) * np.array([0.4, 0.4, 0.3])
        guess = compose(T_ref_cur, rng.uniform(-1, 1, 3) * np.array([1.0, 1.0, 0.78]))
        reference = matcher.prepare([see(ROOM, np.zeros(3), seed)], np.zeros((1, 3)))
        found = matcher.match(reference, see(ROOM, T_ref_cur, seed + 50), guess, np.diag([0.33, 0.33, 0.2]))
        assert isinstance(found, RelativePose)
        error = np.abs(logmap(between(found.T_ref_cur, T_ref_cur)))
        found_all += bool(np.hypot(error[0], error[1]) < 0.03 and error[2] < 0.01)
    assert found_all >= 11


def test_polish_refines_the_grid() -> None:
    rng = np.random.default_rng(1)
    errors = []
    for seed in range(15):
        T_ref_cur = rng.uniform(-1, 1, 3) * np.array([0.2, 0.2, 0.1])
        pair = []
        for iterations in (0, 12):
            matcher = CsmMatcher(CsmConfig(polish_iterations=iterations))
            reference = matcher.prepare([see(ROOM, np.zeros(3), seed)], np.zeros((1, 3)))
            guess = T_ref_cur + np.array([0.013, -0.017, 0.002])
            pose = matcher.track(reference, see(ROOM, T_ref_cur, seed + 50), guess, np.diag([1e-3, 1e-3, 1e-3]))
            assert not isinstance(pose, NoMatch)
            pair.append(np.hypot(*(pose - T_ref_cur)[:2]))
        errors.append(pair)
    coarse, fine = np.median(errors, axis=0)
    assert fine < 0.6 * coarse
    assert fine < 0.01


def test_covariance_is_of_the_errors_size() -> None:
    rng = np.random.default_rng(2)
    matcher = CsmMatcher()
    nees = []
    for seed in range(40):
        T_ref_cur = rng.uniform(-1, 1, 3) * np.array([0.3, 0.3, 0.2])
        guess = compose(T_ref_cur, rng.uniform(-1, 1, 3) * np.array([0.05, 0.05, 0.03]))
        reference = matcher.prepare([see(ROOM, np.zeros(3), seed)], np.zeros((1, 3)))
        found = matcher.match(reference, see(ROOM, T_ref_cur, seed + 50), guess, np.diag([1e-3, 1e-3, 1e-3]))
        assert isinstance(found, RelativePose)
        assert_array_equal(found.covariance, found.covariance.T)
        assert np.linalg.eigvalsh(found.covariance).min() > 0
        xi = logmap(between(found.T_ref_cur, T_ref_cur))
        nees.append(xi @ np.linalg.solve(found.covariance, xi))
    assert 0.3 < np.median(nees) < 6.0


def test_second_moment_of_a_gaussian_peak() -> None:
    """A lone point in a table: the likelihood over x and y is a Gaussian of known width, turning does nothing."""
    config = CsmConfig(independence=1.0, sigma=0.1, cell=0.01, reach_sigmas=4.0, inlier_distance=0.1, weak_facing=0.0)
    matcher = CsmMatcher(config)
    table = np.zeros((201, 201), np.uint8)
    kernels.render_table(np.array([[1.005, 1.005]]), np.zeros(2), 0.01, 0.4, table)
    reference = LikelihoodTable(table=table, origin=np.zeros(2), cell=0.01)
    n = 16
    covariance, _ = matcher.covariance(reference, np.zeros((n, 2)), np.array([1.005, 1.005, 0.0]))
    assert_allclose(np.sqrt(np.diag(covariance)[:2]), 0.1 / math.sqrt(n), rtol=0.25)


def test_a_corridor_is_weak_along_itself() -> None:
    matcher = CsmMatcher()
    T_ref_cur = np.array([0.2, 0.05, 0.1])
    reference = matcher.prepare([see(CORRIDOR, np.zeros(3))], np.zeros((1, 3)))
    found = matcher.match(reference, see(CORRIDOR, T_ref_cur, 1), T_ref_cur, np.diag([1e-3, 1e-3, 1e-3]))
    assert isinstance(found, RelativePose)
    along = np.array([math.cos(-0.1), math.sin(-0.1), 0.0])
    assert len(found.weak_directions) == 1
    assert abs(found.weak_directions[0] @ along) > 0.99
    assert along @ found.covariance @ along > 0.5
    across = np.array([-along[1], along[0], 0.0])
    assert across @ found.covariance @ across < 0.05**2


def test_directions_that_no_surface_faces() -> None:
    along_x = np.stack([np.linspace(-3, 3, 121), np.full(121, 1.0)], axis=1)
    along_y = np.stack([np.full(121, 4.0), np.linspace(-3, 3, 121)], axis=1)
    assert_allclose(np.abs(weak_directions(along_x, 0.3, 0.03)), [[1, 0, 0]], atol=1e-9)
    assert len(weak_directions(np.concatenate([along_x, along_y]), 0.3, 0.03)) == 0
    angles = np.linspace(-np.pi / 2, np.pi / 2, 361)
    circle = 2.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    weak = weak_directions(circle, 0.3, 0.03)
    assert_allclose(np.abs(weak), [[0, 0, 1]], atol=0.02)


def test_pose_and_covariance_turn_with_the_reference() -> None:
    matcher = CsmMatcher()
    T_ref_cur = np.array([0.1, 0.1, 0.3])
    cur, frame = see(ROOM, T_ref_cur, 1), np.array([3.0, -7.0, 2.0])
    guess_covariance = np.diag([1e-3, 1e-3, 1e-3])
    here = matcher.match(matcher.prepare([see(ROOM, np.zeros(3))], np.zeros((1, 3))), cur, T_ref_cur, guess_covariance)
    there = matcher.match(
        matcher.prepare([see(ROOM, np.zeros(3))], frame[None]), cur, compose(frame, T_ref_cur), guess_covariance
    )
    assert isinstance(here, RelativePose)
    assert isinstance(there, RelativePose)
    assert_allclose(between(frame, there.T_ref_cur), here.T_ref_cur, atol=0.01)
    assert_allclose(np.diag(there.covariance), np.diag(here.covariance), rtol=1.0)


def test_several_scans_make_one_reference() -> None:
    matcher = CsmMatcher()
    poses = np.array([[0.0, 0.0, np.pi], [0.2, 0.1, 0.2]])
    reference = matcher.prepare([see(ROOM, pose, k) for k, pose in enumerate(poses)], poses)
    points = np.concatenate([transform_points(pose, see(ROOM, pose, k).points) for k, pose in enumerate(poses)])
    assert kernels.count_values(points, np.zeros(3), reference.table, reference.origin, reference.cell, 0.5)[
        0
    ] > 0.95 * len(points)


def test_says_why_it_finds_nothing() -> None:
    matcher = make_matcher("csm")
    assert isinstance(matcher, CsmMatcher)
    reference = matcher.prepare([see(ROOM, np.zeros(3))], np.zeros((1, 3)))
    blind = Scan(ranges=np.full(181, np.nan, np.float32), geometry=GEOMETRY)
    nothing = matcher.match(reference, blind, np.zeros(3), np.eye(3))
    assert isinstance(nothing, NoMatch)
    assert "only 0 beams" in nothing.reason
    elsewhere = matcher.match(reference, see(ROOM, np.zeros(3)), np.array([40.0, 0.0, 0.0]), 1e-3 * np.eye(3))
    assert isinstance(elsewhere, NoMatch)
    assert "agree with the reference" in elsewhere.reason
    empty = matcher.prepare([blind], np.zeros((1, 3)))
    assert isinstance(matcher.match(empty, see(ROOM, np.zeros(3)), np.zeros(3), 1e-3 * np.eye(3)), NoMatch)


def test_repeats_itself() -> None:
    matcher = CsmMatcher()
    scan, guess = see(ROOM, np.array([0.1, 0.0, 0.05]), 1), np.array([0.05, 0.0, 0.0])
    first, again = (
        matcher.match(matcher.prepare([see(ROOM, np.zeros(3))], np.zeros((1, 3))), scan, guess, 1e-2 * np.eye(3))
        for _ in range(2)
    )
    assert isinstance(first, RelativePose)
    assert isinstance(again, RelativePose)
    assert_array_equal(first.T_ref_cur, again.T_ref_cur)
    assert_array_equal(first.covariance, again.covariance)


@pytest.mark.parametrize(
    "wrong", [{"cell": 0.0}, {"min_inliers": -0.1}, {"min_turn_step": 0.1}, {"inlier_distance": 1.0}, {"points": 3}]
)
def test_settings_outside_their_range(wrong: dict[str, float]) -> None:
    with pytest.raises(MatcherError, match="csm"):
        CsmConfig(**wrong)  # type: ignore[arg-type]
    with pytest.raises(MatcherError, match="at least one scan"):
        CsmMatcher().prepare([], np.empty((0, 3)))
