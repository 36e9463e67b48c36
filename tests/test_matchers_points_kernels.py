"""Kernels of the point matchers against slow NumPy twins and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import minimize

from frontends.matchers import _covariance_kernels, _pair_kernels
from frontends.matchers import _icp_kernels as icp
from frontends.matchers import _outline_kernels as outlines
from frontends.matchers import _weighted_kernels as weighted
from frontends.matchers._fit_kernels import line_fit, metric_normal_equations
from frontends.matchers._outline_kernels import Outline
from frontends.matchers._pair_kernels import Pairs, Trimming
from frontends.matchers.bearing_scan import BearingScan
from frontends.matchers.quad_tree import QuadTree
from frontends.matchers.weighted_points import PointNoiseConfig, weigh_scan
from frontends.scan import Scan, ScanGeometry
from tests.kernels import from_python

ACCELERATE = from_python(icp._accelerate)
EVERY_PAIR = Trimming(1.0, 1.0, 0.7, math.inf, 3)
seeds = st.integers(0, 2**32 - 1)


def polar_cloud(rng: np.random.Generator, n: int, opening: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    bearings = np.sort(rng.uniform(-opening / 2, opening / 2, n))
    ranges = rng.uniform(0.3, 6.0, n)
    return bearings, np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings)])


def outline_of(xy: NDArray[np.float64], bearings: NDArray[np.float64], linked: NDArray[np.bool_]) -> Outline:
    return Outline(xy, bearings, linked, np.zeros(len(xy), np.int8))


def metric_square(delta: NDArray[np.float64], p: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Minguez et al., equation of the distance: |δ|² − (δ × p)²/(|p|² + L²)."""
    cross = delta[..., 0] * p[1] - delta[..., 1] * p[0]
    return np.asarray((delta**2).sum(axis=-1) - cross**2 / (p @ p + length**2))


def slow_closest(p: NDArray[np.float64], xy: NDArray[np.float64], linked: NDArray[np.bool_], length: float) -> float:
    """Least squared distance over all points and 20001 samples of every linked piece."""
    least = float(metric_square(xy - p, p, length).min())
    shares = np.linspace(0.0, 1.0, 20001)[:, None]
    for j in np.flatnonzero(linked):
        along = xy[j] + shares * (xy[(j + 1) % len(xy)] - xy[j])
        least = min(least, float(metric_square(along - p, p, length).min()))
    return least


@settings(max_examples=60)
@given(seed=seeds, opening=st.sampled_from([1.0, math.pi, 4.7, 2 * math.pi]), length=st.sampled_from([3.0, math.inf]))
def test_closest_point_is_the_closest(seed: int, opening: float, length: float) -> None:
    rng = np.random.default_rng(seed)
    bearings, xy = polar_cloud(rng, 25, opening)
    linked = rng.random(25) < 0.3
    linked[-1] = opening > 6.0 and linked[-1]
    p = rng.uniform(-5.0, 5.0, 2)
    for hint in (-1, int(rng.integers(25))):
        x, y, d2, j = outlines.closest(p[0], p[1], outline_of(xy, bearings, linked), length**2, math.pi, 1e6, hint)
        assert d2 == pytest.approx(float(metric_square(np.array([x, y]) - p, p, length)), abs=1e-9)
        assert d2 == pytest.approx(slow_closest(p, xy, linked, length), abs=1e-5)
        assert 0 <= j < 25


def test_closest_point_respects_limit_and_window() -> None:
    bearings = np.array([-0.5, 0.0, 0.5])
    xy = 2.0 * np.column_stack([np.cos(bearings), np.sin(bearings)])
    outline = outline_of(xy, bearings, np.zeros(3, np.bool_))
    assert outlines.closest(5.0, 0.0, outline, math.inf, math.pi, 4.0, -1)[3] == -1
    assert outlines.closest(5.0, 0.0, outline, math.inf, math.pi, 9.1, -1)[3] == 1
    assert outlines.closest(0.0, 2.0, outline, math.inf, 0.3, 100.0, -1)[3] == -1
    assert outlines.closest(0.0, 2.0, outline, math.inf, 0.3, 100.0, 2)[3] == -1  # nor by a hint


@settings(max_examples=60)
@given(seed=seeds)
def test_matching_range_is_the_nearest_crossing_in_bearing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bearings = np.linspace(-1.5, 1.5, 61)
    ranges = 4.0 + np.cumsum(rng.normal(0.0, 0.1, 61))
    xy = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings)])
    linked = np.r_[np.ones(60, np.bool_), False]
    at, r, window = rng.uniform(-1.0, 1.0), rng.uniform(3.0, 5.0), 0.4
    x, y, found = outlines.matching_range(
        r * math.cos(at), r * math.sin(at), outline_of(xy, bearings, linked), ranges, window
    )
    crossing = [
        bearings[j] + (r - ranges[j]) / (ranges[j + 1] - ranges[j]) * (bearings[j + 1] - bearings[j])
        for j in range(60) if (ranges[j] - r) * (ranges[j + 1] - r) <= 0
    ]  # fmt: skip
    near = [b for b in crossing if abs(b - at) <= window]
    assert found
    if near:
        best = min(near, key=lambda b: abs(b - at))
        assert math.atan2(y, x) == pytest.approx(best, abs=0.01)
        assert math.hypot(x, y) == pytest.approx(r, abs=0.02)
    else:
        inside = np.abs(bearings - at) <= window
        assert abs(math.hypot(x, y) - r) == pytest.approx(np.abs(ranges[inside] - r).min())


@settings(max_examples=40)
@given(seed=seeds, turn=st.floats(-3.0, 3.0))
def test_line_fit_is_the_constrained_minimum(seed: int, turn: float) -> None:
    """Noise-free it returns the motion; with noise no other start of a numeric minimiser gets lower."""
    rng = np.random.default_rng(seed)
    n = 40
    angles = rng.uniform(-math.pi, math.pi, n)
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    p = rng.uniform(-4.0, 4.0, (n, 2))
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    exact = p @ rotation.T + [0.3, -0.2] + rng.uniform(-1, 1, (n, 1)) * normals[:, ::-1] * [-1.0, 1.0]
    kept = np.ones(n, np.bool_)
    x, y, angle = line_fit(p, exact, normals, kept, 1e-9)
    assert (x, y) == pytest.approx((0.3, -0.2), abs=1e-6)
    assert math.remainder(angle - turn, 2 * math.pi) == pytest.approx(0.0, abs=1e-6)

    q = exact + rng.normal(0.0, 0.4, (n, 2))

    def cost(v: NDArray[np.float64]) -> float:
        c, s = math.cos(v[2]), math.sin(v[2])
        moved = np.column_stack([v[0] + c * p[:, 0] - s * p[:, 1], v[1] + s * p[:, 0] + c * p[:, 1]])
        return float((((moved - q) * normals).sum(axis=1) ** 2).sum())

    x, y, angle = line_fit(p, q, normals, kept, 1e-12)
    numeric = min(minimize(cost, [0.0, 0.0, a]).fun for a in (-2.0, 0.0, 2.0))
    assert cost(np.array([x, y, angle])) <= numeric * (1 + 1e-6) + 1e-9


def wall(distance: float = 2.0, n: int = 61, opening: float = 1.2) -> BearingScan:
    """A wall straight ahead: x = distance."""
    geometry = ScanGeometry(bearings=np.linspace(-opening / 2, opening / 2, n), range_min=0.1, range_max=50.0)
    ranges = (distance / np.cos(geometry.bearings)).astype(np.float32)
    return BearingScan.of(Scan(ranges=ranges, geometry=geometry))


def facing_wall(distance: float, n: int) -> tuple[Outline, Pairs]:
    """A wall seen head on, and each of its points paired with itself."""
    points = wall(distance, n)
    outline = Outline(points.xy, points.bearings, np.r_[np.ones(n - 1, np.bool_), False], np.zeros(n, np.int8))
    pairs = _pair_kernels.no_pairs(n)
    _pair_kernels.associate(outline, points.xy, np.zeros(3), math.inf, math.pi, EVERY_PAIR, pairs)
    assert _pair_kernels.trim(EVERY_PAIR, pairs) == n
    return outline, pairs


def test_covariance_is_censis_closed_form_for_one_wall() -> None:
    """A wall at x = 2 seen at bearings b: rows (1, 0, −y); a range of either scan moves its row's distance by cos b."""
    outline, pairs = facing_wall(2.0, 61)
    H, M, (count, total) = _covariance_kernels.covariance_parts(outline, pairs, np.zeros(3))
    b = np.linspace(-0.6, 0.6, 61)[:60]  # no piece of wall begins at the last point
    rows = np.column_stack([np.ones(60), np.zeros(60), -2.0 * np.tan(b)])
    assert count == 60
    assert total == pytest.approx(0.0, abs=1e-9)
    assert pytest.approx(rows.T @ rows, rel=1e-5, abs=1e-5) == H
    assert pytest.approx(2 * (rows.T * np.cos(b) ** 2) @ rows, rel=1e-4, abs=1e-4) == M
    assert H[1, 1] == pytest.approx(0.0, abs=1e-9)  # nothing along the wall, though every point has its twin


def test_metric_normal_equations_are_those_of_the_metric() -> None:
    """H of the metric: the shortest motion (x, y, Lθ) of a point costs what the metric says."""
    _, xy = polar_cloud(np.random.default_rng(5), 50, 3.0)
    H, g = metric_normal_equations(xy, xy, np.ones(50, np.bool_), 9.0)
    expected = np.zeros((3, 3))
    for x, y in xy:
        J = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])
        k = np.array([y, -x])
        expected += J.T @ (np.eye(2) - np.outer(k, k) / (x * x + y * y + 9.0)) @ J
    assert pytest.approx(expected, rel=1e-9, abs=1e-9) == H
    assert g == pytest.approx(np.zeros(3), abs=1e-9)


def test_pairs_at_the_end_of_what_was_seen_are_left_out() -> None:
    """A wall seen from y = −1 to 1 with a gap after y = 0.5: beyond its ends nothing is known."""
    y = np.array([-1.0, -0.5, 0.0, 0.5, 0.8, 1.0])
    xy = np.column_stack([np.full(6, 2.0), y])
    linked = np.array([True, True, True, False, True, False])
    outline = Outline(xy, np.arctan2(y, 2.0), linked, np.array([2, 0, 0, 1, 1, 2], np.int8))
    points = np.array([[2.1, -1.3], [2.1, -0.7], [2.1, 0.6], [2.1, 0.9], [2.1, 1.2]])
    for least_end, expected in ((1, [1, 3]), (2, [1, 2, 3]), (3, [0, 1, 2, 3, 4])):
        pairs = _pair_kernels.no_pairs(5)
        _pair_kernels.associate(
            outline, points, np.zeros(3), math.inf, math.pi, EVERY_PAIR._replace(least_end=least_end), pairs
        )
        assert np.flatnonzero(np.isfinite(pairs.squares)).tolist() == expected


def test_short_steps_that_keep_their_direction_are_led_to_their_end() -> None:
    """Steps 0.02, 0.01 along x lead on by 0.01, as their geometric series does; a turn to the side leads nowhere."""
    pose, steps = np.array([0.03, 0.0, 0.0]), np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0]])
    ACCELERATE(np.array([0.02, 0.0, 0.0]), pose, steps)
    assert pose == pytest.approx([0.04, 0.0, 0.0])
    assert not steps.any()
    sideways, steps = np.array([0.02, 0.01, 0.0]), np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0]])
    ACCELERATE(np.array([0.02, 0.0, 0.0]), sideways, steps)
    assert sideways == pytest.approx([0.02, 0.01, 0.0])


def test_long_steps_are_not_led_on() -> None:
    """Far from the end the pairs of points still change by chance, and with them where the steps lead."""
    pose, steps = np.array([0.6, 0.0, 0.0]), np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])
    ACCELERATE(np.array([0.4, 0.0, 0.0]), pose, steps)
    assert pose == pytest.approx([0.6, 0.0, 0.0])


def test_closeness_tells_how_near_points_lie_to_the_surface() -> None:
    """On it, 3 cm and 20 cm off it, and beyond its end by 4 cm: 1, 1 − 0.3², 0 and 1 − 0.4² with a reach of 10 cm."""
    xy = np.array([[2.0, -1.0], [2.0, 0.0], [2.0, 1.0]])
    outline = outline_of(xy, np.arctan2(xy[:, 1], xy[:, 0]), np.array([True, True, False]))
    points = np.array([[2.0, 0.3], [1.97, -0.3], [2.2, 0.5], [2.0, 1.04]])
    shifted = points - [0.5, 0.2]
    close = _pair_kernels.closeness(outline, shifted, np.array([0.5, 0.2, 0.0]), 0.1)
    assert close == pytest.approx((1.0 + 0.91 + 0.0 + 0.84) / 4)


@settings(max_examples=60)
@given(seed=seeds, n=st.integers(1, 400), clumped=st.booleans())
def test_quad_tree_finds_the_nearest_point(seed: int, n: int, clumped: bool) -> None:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-10.0, 10.0, (n, 2))
    if clumped:
        xy[n // 2 :] = xy[0]
    queries = rng.uniform(-12.0, 12.0, (30, 2))
    indices, distances = QuadTree.of(xy).nearest(queries)
    slow = np.linalg.norm(queries[:, None] - xy[None], axis=2)
    assert distances == pytest.approx(slow.min(axis=1))
    assert slow[np.arange(30), indices] == pytest.approx(slow.min(axis=1))
    near, _ = QuadTree.of(xy).nearest(queries, 1.0)
    assert np.array_equal(near >= 0, slow.min(axis=1) < 1.0)


def test_quad_tree_keeps_every_point_once_and_an_empty_one_finds_nothing() -> None:
    xy = np.random.default_rng(0).normal(size=(500, 2))
    tree = QuadTree.of(xy)
    assert np.array_equal(np.sort(tree.nodes.order), np.arange(500))
    assert tree.nodes.leaves[:, 1].sum() == 500
    indices, _ = QuadTree.of(np.empty((0, 2))).nearest(xy[:3])
    assert (indices == -1).all()


def full(row: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([[row[0], row[1]], [row[1], row[2]]])


def test_point_model_is_pfisters() -> None:
    scan_points = wall()
    geometry = ScanGeometry(bearings=np.linspace(-0.6, 0.6, 61), range_min=0.1, range_max=50.0)
    scan = Scan(ranges=(2.0 / np.cos(geometry.bearings)).astype(np.float32), geometry=geometry)
    points = weigh_scan(scan, PointNoiseConfig())
    for i in (0, 17, 30, 55):
        r, b = scan_points.ranges[i], scan_points.bearings[i]
        u, v = np.array([math.cos(b), math.sin(b)]), np.array([-math.sin(b), math.cos(b)])
        assert full(points.noise[i]) == pytest.approx(1e-4 * np.outer(u, u) + (0.002 * r) ** 2 * np.outer(v, v))
        assert np.abs(points.tangents[i]) == pytest.approx([0.0, 1.0], abs=1e-4)
        step, beta = 0.02, math.pi / 2 - abs(b)  # incidence between beam and wall
        shorter = r * math.sin(step) / math.sin(min(beta + step, math.pi / 2))
        longer = r * math.sin(step) / math.sin(beta - step)
        expected = (shorter**3 + longer**3) / (3 * (shorter + longer))
        assert points.spreads[i] ** 2 == pytest.approx(expected, rel=2e-3)


def weighted_self_match(xy: NDArray[np.float64], ranges: NDArray[np.float32], bearings: NDArray[np.float64]
                        ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Kernel's information of a scan against itself, and ΣP⁻¹ written out."""
    geometry = ScanGeometry(bearings=bearings, range_min=0.1, range_max=50.0)
    points = weigh_scan(Scan(ranges=ranges, geometry=geometry), PointNoiseConfig())
    assert points.tree.xy == pytest.approx(xy, abs=1e-5)
    cloud = points.cloud()._replace(ends=np.zeros(len(xy), np.int8))
    rules = weighted.Rules(False, 1.0, 1.0, 5.0, 30, 1e-3, 1e-6)
    pose, information, _ = weighted.weighted_match(cloud, cloud, np.zeros(3), rules)
    assert pose == pytest.approx(np.zeros(3), abs=1e-9)
    total = np.zeros((2, 2))
    for noise, tangent, spread in zip(points.noise, points.tangents, points.spreads, strict=True):
        total += np.linalg.inv(2 * full(noise) + spread**2 * np.outer(tangent, tangent))
    return information, total


def test_wsm_covariance_of_one_wall_is_the_closed_form() -> None:
    """ΣP⁻¹ of a wall at x = 2: tight across it, along it only what the sampling leaves; no coupling by symmetry."""
    points = wall()
    information, total = weighted_self_match(points.xy, points.ranges.astype(np.float32), points.bearings)
    assert information[:2, :2] == pytest.approx(total, rel=1e-6, abs=1e-3 * total[0, 0])
    covariance = np.linalg.inv(total)
    assert math.sqrt(covariance[0, 0]) == pytest.approx(0.01 * math.sqrt(2 / 61), rel=0.2)
    assert math.sqrt(covariance[1, 1]) > 2 * math.sqrt(covariance[0, 0])
    assert abs(covariance[0, 1]) < 1e-3 * covariance[1, 1]
    assert information[1, 2] == pytest.approx(2.0 * total[1, 1], rel=0.05)  # the wall's middle lies 2 m ahead


def test_wsm_covariance_of_a_corner_is_tight_both_ways() -> None:
    """Two walls, x = 2 and y = 2, seen alike: the covariance is symmetric in x and y."""
    bearings = np.linspace(0.0, math.pi / 2, 91)
    ranges = (2.0 / np.maximum(np.cos(bearings), np.sin(bearings))).astype(np.float32)
    xy = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings)]).astype(np.float64)
    information, total = weighted_self_match(xy, ranges, bearings)
    assert information[:2, :2] == pytest.approx(total, rel=1e-4, abs=1e-4 * total[0, 0])
    covariance = np.linalg.inv(total)
    assert covariance[0, 0] == pytest.approx(covariance[1, 1], rel=0.02)
    assert math.sqrt(covariance[0, 0]) < 0.01 * math.sqrt(2 / 45) * 1.3


def pairs_with(squares: list[float]) -> Pairs:
    pairs = _pair_kernels.no_pairs(len(squares))
    pairs.squares[:] = squares
    return pairs


def test_trimming_keeps_the_smallest_share() -> None:
    pairs = pairs_with([4.0, math.inf, 1.0, 3.0, 2.0, math.inf])
    assert _pair_kernels.trim(EVERY_PAIR._replace(share=0.5), pairs) == 2
    assert pairs.kept.tolist() == [False, False, True, False, True, False]
    # Twice the median distance, 1, is 2: a squared distance of 4 is the last within.
    pairs = pairs_with([1.0, 1.0, 1.0, 4.0, 4.1])
    assert _pair_kernels.trim(EVERY_PAIR._replace(order=0.5, factor=2.0), pairs) == 4
    assert _pair_kernels.trim(EVERY_PAIR, pairs_with([math.inf] * 6)) == 0


def test_hidden_points_fall_behind_in_bearing_order() -> None:
    bearings = np.array([0.0, 0.1, 0.3, 0.2, 0.25, 0.4])
    pairs = pairs_with([0.0] * 6)
    pairs.moved[:] = 2.0 * np.column_stack([np.cos(bearings), np.sin(bearings)])
    _pair_kernels.drop_hidden(pairs)
    assert np.isinf(pairs.squares).tolist() == [False, False, False, True, True, False]
