"""The covariance from scores: against the closed form of a Gaussian, white and repeated noise, weak directions."""

import numpy as np
import pytest
from numpy.typing import NDArray

from iceg.ice import _score_grid_kernels as grid_kernels
from iceg.ice import _score_kernels as kernels
from iceg.ice.config import CovarianceConfig, FeatureConfig, LocalMapConfig, RefinementConfig
from iceg.ice.covariance import ScoreCovariance, score_covariance
from iceg.ice.features import FeatureRows
from iceg.ice.local_map import LocalMap
from iceg.ice.points import ScanPoints
from iceg.ice.refinement import FACING, evaluate_points
from iceg.ice.scored import Scored
from tests.kernels import from_python

residuals_at = from_python(kernels._residuals_at)
dependence = from_python(kernels._dependence)
unevenness = from_python(kernels._unevenness)
pretence = from_python(kernels._pretence)
moments = from_python(kernels._moments)

F64 = NDArray[np.float64]
NO_FEATURES = FeatureRows(kinds=np.empty(0, np.int8), rows=np.empty((0, 10)))


def walls(*sides: str, noise: F64 | float = 0.0, n: int = 100) -> ScanPoints:
    """Points on chosen sides of a box of 8 by 8 m, with their normals."""
    line = np.linspace(-3.9, 3.9, n)
    ends = np.full_like(line, 4.0)
    table = {
        "left": (np.c_[line, ends], [0.0, -1.0]),
        "right": (np.c_[line, -ends], [0.0, 1.0]),
        "front": (np.c_[ends, line], [-1.0, 0.0]),
    }
    points = np.concatenate([table[side][0] for side in sides])
    normals = np.repeat([table[side][1] for side in sides], n, axis=0)
    return ScanPoints(
        points=points + np.asarray(noise).reshape(-1, 1) * normals,
        normals=normals,
        beams=np.arange(len(points), dtype=np.int32),
        spreads=np.ones(len(points)),
    )


def map_of(scan_points: ScanPoints) -> LocalMap:
    local_map = LocalMap(np.array([-7.0, -7.0]), np.array([7.0, 7.0]), LocalMapConfig(), FeatureConfig())
    local_map.add(scan_points, NO_FEATURES, np.zeros(3))
    return local_map


def covariance_of(reference: ScanPoints, scan: ScanPoints, config: CovarianceConfig | None = None) -> ScoreCovariance:
    local_map = map_of(reference)
    at = evaluate_points(scan, local_map, np.zeros(3), RefinementConfig())
    return score_covariance(scan, local_map, at, RefinementConfig(), config or CovarianceConfig())


def test_moments_of_a_gaussian_are_its_covariance() -> None:
    sigma, steps = np.array([0.02, 0.1, 0.004]), np.array([0.01, 0.05, 0.002])
    offsets = np.stack(np.meshgrid(*[np.arange(-8, 9) * s for s in steps], indexing="ij"), axis=-1)
    off_centre = np.array([0.01, -0.02, 0.001])
    costs = 3.0 + 0.5 * (((offsets - off_centre) / sigma) ** 2).sum(axis=-1)
    second, edges = np.empty((3, 3)), np.empty(3)
    moments(costs, float(costs.min()), 1.0, steps, second, edges)
    # Σ = K/s - uuᵀ/s² about the mean, plus the variance of a cell.
    np.testing.assert_allclose(second, np.diag(sigma**2 + steps**2 / 12), rtol=2e-3, atol=1e-9)
    assert costs.sum() == pytest.approx(1.0)
    assert (edges < 1e-2).all()


def test_a_flat_score_lies_on_the_edge() -> None:
    costs, second, edges = np.zeros((5, 5, 5)), np.empty((3, 3)), np.empty(3)
    moments(costs, 0.0, 1.0, np.ones(3), second, edges)
    np.testing.assert_allclose(edges, 0.4)
    np.testing.assert_allclose(second, np.eye(3) * (2.0 + 1 / 12), atol=1e-12)


def test_the_costs_against_a_slow_twin() -> None:
    rng = np.random.default_rng(0)
    scan = walls("left", "front", noise=rng.normal(0, 0.02, 200))
    local_map = map_of(walls("left", "front"))
    pose, axes, steps = (
        np.array([0.02, -0.03, 0.4]),
        np.linalg.qr(rng.normal(size=(3, 3)))[0],
        np.array([0.1, 0.2, 0.05]),
    )
    costs, field = np.empty((3, 3, 3)), local_map.fine
    scored = Scored.of(scan, local_map, RefinementConfig())
    best = grid_kernels.score_grid(scored, 50, pose, axes, steps, costs)
    picked = ((np.arange(50) + 0.5) * 4).astype(int)
    for index in np.ndindex(3, 3, 3):
        d = axes @ ((np.array(index) - 1) * steps)
        c0, s0 = np.cos(pose[2]), np.sin(pose[2])
        c, s = np.cos(pose[2] + d[2]), np.sin(pose[2] + d[2])
        R = np.array([[c, -s], [s, c]])
        p = pose[:2] + [c0 * d[0] - s0 * d[1], s0 * d[0] + c0 * d[1]] + scan.points[picked] @ R.T
        n = scan.normals[picked] @ R.T
        cost = 0.0
        for point, normal in zip(p, n, strict=True):
            u, v = np.floor((point - field.origin) / field.cell).astype(int)
            k = field.nearest[v, u]
            factor = 10.0
            if k >= 0 and normal @ local_map.surfels[k, 2:] >= FACING:
                r = local_map.surfels[k, 2:] @ (point - local_map.surfels[k, :2])
                factor = min(10.0, 1 + (r / 0.04) ** 2)
            cost += np.log(factor)
        assert costs[index] == pytest.approx(cost, rel=1e-9)
    assert best == costs.min()


def test_many_points_far_off_the_reference_cost_ten_each() -> None:
    local_map, scored_points = map_of(walls("left", "front")), np.full((500, 2), 90.0)
    costs = np.empty((3, 1, 3))
    scan = ScanPoints(
        points=scored_points, normals=np.zeros((500, 2)), beams=np.arange(500, dtype=np.int32), spreads=np.ones(500)
    )
    scored = Scored.of(scan, local_map, RefinementConfig())
    grid_kernels.score_grid(scored, 450, np.zeros(3), np.eye(3), np.full(3, 0.1), costs)
    np.testing.assert_allclose(costs, 450 * np.log(10.0), rtol=1e-12)


def test_small_white_noise_gives_the_least_squares_covariance() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(0, 0.01, 300)
    config = CovarianceConfig(independence=1.0, points=300)
    got = covariance_of(walls("left", "right", "front"), walls("left", "right", "front", noise=noise), config)
    scan = walls("left", "right", "front")
    n, p = scan.normals, scan.points
    J = np.c_[n, p[:, 0] * n[:, 1] - p[:, 1] * n[:, 0]]
    expected = 0.01**2 * np.linalg.inv(J.T @ J)
    assert not len(got.weak_directions)
    ratio = np.linalg.eigvals(np.linalg.solve(expected, got.covariance)).real
    # The costs are robust, the grid has five poses a side and the noise is what these points happen to have.
    assert (ratio > 0.3).all()
    assert (ratio < 2.0).all()


def test_errors_that_neighbours_share_do_not_average_out() -> None:
    rng = np.random.default_rng(2)
    white = rng.normal(0, 0.012, 300)
    shared = np.repeat(rng.normal(0, 0.012, 30), 10)
    reference = walls("left", "right", "front")
    from_white = covariance_of(reference, walls("left", "right", "front", noise=white)).covariance
    from_shared = covariance_of(reference, walls("left", "right", "front", noise=shared)).covariance
    assert np.trace(from_shared) > 3 * np.trace(from_white)


def test_dependence_counts_what_neighbours_share() -> None:
    rng = np.random.default_rng(3)
    local_map = map_of(walls("left", "right", "front", n=800))

    def of(noise: F64) -> float:
        scan = walls("left", "right", "front", noise=noise, n=800)
        scored = Scored.of(scan, local_map, RefinementConfig())
        return float(dependence(residuals_at(scored, np.zeros(3), 0.08)))

    assert of(rng.normal(0, 0.01, 2400)) < 1.4
    # Blocks of four equal errors: ρ = 3/4, 1/2, 1/4, hence 1 + 2 Σ (1 - l/13) ρ = 3.62.
    assert of(np.repeat(rng.normal(0, 0.01, 600), 4)) == pytest.approx(3.62, abs=0.6)


def test_a_corridor_is_weak_along_it_and_a_room_is_not() -> None:
    rng = np.random.default_rng(4)
    corridor = covariance_of(walls("left", "right"), walls("left", "right", noise=rng.normal(0, 0.01, 200)))
    assert corridor.weak_directions.shape == (1, 3)
    np.testing.assert_allclose(np.abs(corridor.weak_directions[0]), [1.0, 0.0, 0.0], atol=0.05)
    assert corridor.covariance[0, 0] == pytest.approx(1.0, rel=0.02)
    assert corridor.covariance[1, 1] < 0.02**2
    room = covariance_of(
        walls("left", "right", "front"), walls("left", "right", "front", noise=rng.normal(0, 0.01, 300))
    )
    assert room.weak_directions.shape == (0, 3)
    assert room.covariance[0, 0] < 0.02**2


@pytest.mark.parametrize("sides", [("left",), ("left", "right"), ("left", "front"), ("left", "right", "front")])
def test_every_covariance_is_symmetric_and_positive_definite(sides: tuple[str, ...]) -> None:
    got = covariance_of(walls(*sides), walls(*sides, noise=np.random.default_rng(5).normal(0, 0.02, 100 * len(sides))))
    np.testing.assert_array_equal(got.covariance, got.covariance.T)
    assert np.linalg.eigvalsh(got.covariance).min() > 0
    assert got.weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(got.axes.T @ got.axes, np.eye(3), atol=1e-9)


def test_unevenness_equals_its_slow_twin() -> None:
    rng = np.random.default_rng(6)
    noise = np.concatenate([rng.normal(0, 0.005, 200), np.repeat(rng.normal(0, 0.015, 20), 5)])
    scan, local_map = walls("left", "right", "front", noise=noise), map_of(walls("left", "right", "front"))
    pose, axes, ratios = np.array([0.01, -0.005, 0.02]), np.linalg.qr(rng.normal(size=(3, 3)))[0], np.empty(3)
    field, variance = local_map.fine, 1e-4
    found = residuals_at(Scored.of(scan, local_map, RefinementConfig()), pose, 0.08)
    unevenness(found, axes, 1e-6, variance, ratios)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    R = np.array([[c, -s], [s, c]])
    pulls, levers = np.zeros((300, 3)), np.zeros((300, 3))
    for i, (point, normal) in enumerate(zip(scan.points, scan.normals, strict=True)):
        p = pose[:2] + R @ point
        u, v = np.floor((p - field.origin) / field.cell).astype(int)
        k = field.nearest[v, u]
        if k < 0 or (R @ normal) @ local_map.surfels[k, 2:] < FACING:
            continue
        r, m = local_map.surfels[k, 2:] @ (p - local_map.surfels[k, :2]), R.T @ local_map.surfels[k, 2:]
        if abs(r) < 0.08:
            levers[i] = axes.T @ [m[0], m[1], m[1] * point[0] - m[0] * point[1]]
            pulls[i] = r * levers[i]
    squares, fourth = (levers**2).sum(axis=0), (levers**4).sum(axis=0)
    shared = sum((1 - lag / 13) * (pulls[lag:] * pulls[:-lag]).sum(axis=0) for lag in range(1, 13))
    meat = np.maximum((pulls**2).sum(axis=0) + 2 * np.maximum(shared, 0.0), 1e-6 * squares)
    held_by = squares**2 / fourth
    np.testing.assert_allclose(ratios, (10 + held_by * meat / (variance * squares)) / (10 + held_by), rtol=1e-9)


def curved(centre_y: float, radius: float, n: int, rng: np.random.Generator) -> ScanPoints:
    """Points of a wall on a circle about (0, centre_y), their normals off by three degrees each."""
    bearings = np.linspace(-0.3, 0.3, n) - np.sign(centre_y) * np.pi / 2
    outwards = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    tilts = bearings + rng.normal(0, 0.05, n)
    side = -1.0 if radius > abs(centre_y) else 1.0
    return ScanPoints(
        points=np.array([0.0, centre_y]) + radius * outwards + rng.normal(0, 0.01, (n, 1)) * outwards,
        normals=side * np.stack([np.cos(tilts), np.sin(tilts)], axis=1),
        beams=np.arange(n, dtype=np.int32),
        spreads=np.ones(n),
    )


def joined_points(*parts: ScanPoints) -> ScanPoints:
    points, normals = np.vstack([p.points for p in parts]), np.vstack([p.normals for p in parts])
    beams = np.arange(len(points), dtype=np.int32)
    return ScanPoints(points=points, normals=normals, beams=beams, spreads=np.ones(len(points)))


def test_tilted_normals_do_not_hold_a_scan_in_a_curved_corridor() -> None:
    rng = np.random.default_rng(8)
    reference, scan = (joined_points(curved(20.0, 21.3, 150, rng), curved(20.0, 18.7, 150, rng)) for _ in range(2))
    got = covariance_of(reference, scan)
    assert len(got.weak_directions) == 1
    along = got.weak_directions[0] / got.weak_directions[0, 0]
    np.testing.assert_allclose(along, [1.0, 0.0, 0.05], atol=0.02)


def test_three_points_do_not_hold_a_corridor_and_thirty_do() -> None:
    rng = np.random.default_rng(9)

    def scan_with(n: int) -> ScanPoints:
        ahead = walls("front", noise=rng.normal(0, 0.01, n), n=n)
        return joined_points(walls("left", "right", noise=rng.normal(0, 0.01, 200)), ahead)

    reference = walls("left", "right", "front")
    assert covariance_of(reference, scan_with(3)).covariance[0, 0] > 0.2**2
    assert covariance_of(reference, scan_with(30)).covariance[0, 0] < 0.01**2


def test_pretence_equals_its_slow_twin() -> None:
    rng = np.random.default_rng(10)
    scan, local_map = walls("left", "right", "front", noise=rng.normal(0, 0.01, 300)), map_of(walls("left", "right"))
    found = residuals_at(Scored.of(scan, local_map, RefinementConfig()), np.zeros(3), 0.08)
    for axis in np.linalg.qr(rng.normal(size=(3, 3)))[0].T:
        told, crossed = (found.levers @ axis) ** 2, (found.levers @ axis) * (found.own_levers @ axis)
        expected = max(1.0, told.sum() / max(np.sort(crossed)[:-3].sum(), 1e-3 * told.sum()))
        assert pretence(found, axis) == pytest.approx(expected)


def test_a_direction_is_known_as_well_as_the_points_that_hold_it() -> None:
    rng = np.random.default_rng(7)
    even = rng.normal(0, 0.01, 300)
    uneven = np.concatenate([rng.normal(0, 0.004, 200), rng.normal(0, 0.018, 100)])  # the wall ahead is rough
    reference = walls("left", "right", "front")
    same = covariance_of(reference, walls("left", "right", "front", noise=even)).covariance
    rough_ahead = covariance_of(reference, walls("left", "right", "front", noise=uneven)).covariance
    assert rough_ahead[0, 0] / rough_ahead[1, 1] > 3 * same[0, 0] / same[1, 1]
