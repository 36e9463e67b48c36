"""The polish on points against SciPy's least squares, its linear algebra against NumPy's, the polish on features."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import least_squares

from graph.se2 import between, compose, inverse
from iceg.ice import _refinement_kernels as kernels
from iceg.ice import _score_kernels as score_kernels
from iceg.ice.config import FeatureConfig, LocalMapConfig, RefinementConfig
from iceg.ice.features import CORNER, FeatureRows
from iceg.ice.local_map import LocalMap
from iceg.ice.points import ScanPoints
from iceg.ice.refinement import evaluate_points, polish_on_features, refine_on_points
from tests.kernels import from_python

solve_step = from_python(kernels._solve_step)

principal_axes = from_python(score_kernels._principal_axes)

F64 = NDArray[np.float64]
NO_FEATURES = FeatureRows(kinds=np.empty(0, np.int8), rows=np.empty((0, 10)))


def box_points(noise: float = 0.0, seed: int = 0) -> ScanPoints:
    """Points on three walls of a box of 4 by 4 m, with their normals."""
    rng = np.random.default_rng(seed)
    line = np.linspace(-1.4, 1.4, 60)
    ends = np.full_like(line, 2.0)
    points = np.concatenate([np.c_[line, ends], np.c_[ends, line], np.c_[line, -ends]])
    normals = np.repeat([[0.0, -1.0], [-1.0, 0.0], [0.0, 1.0]], 60, axis=0)
    return ScanPoints(
        points=points + rng.normal(0, noise, (180, 1)) * normals,
        normals=normals,
        beams=np.arange(180, dtype=np.int32),
        spreads=np.ones(180),
    )


def seen_from(scan_points: ScanPoints, pose: F64) -> ScanPoints:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    R = np.array([[c, -s], [s, c]])
    return replace(scan_points, points=(scan_points.points - pose[:2]) @ R, normals=scan_points.normals @ R)


def map_of(scan_points: ScanPoints) -> LocalMap:
    local_map = LocalMap(np.array([-6.0, -6.0]), np.array([6.0, 6.0]), LocalMapConfig(), FeatureConfig())
    local_map.add(scan_points, NO_FEATURES, np.zeros(3))
    return local_map


def is_beyond(point: F64, k: int, local_map: LocalMap) -> bool:
    """Whether no surfel is known farther along the surface than a point, looked up as far behind it as one before."""
    field, (x, y, nx, ny) = local_map.fine, local_map.surfels[k]
    tangent = np.array([-ny, nx])
    along = float(tangent @ (point - [x, y]))
    if abs(along) <= field.cell:
        return False
    column, row = np.floor((np.array([x, y]) + 2 * along * tangent - field.origin) / field.cell).astype(int)
    is_inside = 0 <= column < field.nearest.shape[1] and 0 <= row < field.nearest.shape[0]
    other = field.nearest[row, column] if is_inside else -1
    reached = float(tangent @ (local_map.surfels[other, :2] - [x, y])) * np.sign(along)
    return bool(other < 0 or reached < abs(along))


def residuals(pose: F64, scan_points: ScanPoints) -> F64:
    """Distances to the walls of the box that the points belong to."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    p = pose[:2] + scan_points.points @ np.array([[c, s], [-s, c]])
    return np.concatenate([p[:60, 1] - 2.0, p[60:120, 0] - 2.0, -p[120:, 1] - 2.0])


def test_the_polish_is_the_robust_least_squares_optimum() -> None:
    local_map, true = map_of(box_points()), np.array([0.15, -0.1, 0.06])
    scan = seen_from(box_points(noise=0.02, seed=1), true)
    config = RefinementConfig(scale=0.04)
    got = refine_on_points(scan, local_map, np.zeros(3), config, wide=False)
    # Cauchy weights at width 0.04 m: SciPy's "cauchy" loss with f_scale = 0.04.
    twin = least_squares(residuals, np.zeros(3), loss="cauchy", f_scale=0.04, args=(scan,))
    np.testing.assert_allclose(got.T_ref_cur, twin.x, atol=5e-4)
    np.testing.assert_allclose(got.T_ref_cur, true, atol=0.01)
    r = residuals(got.T_ref_cur, scan)
    w = 1 / (1 + (r / 0.04) ** 2)
    assert got.used == 180
    assert got.inliers == (np.abs(r) < 0.08).sum()
    assert got.support == pytest.approx(w.sum(), rel=1e-3)
    assert got.residual == pytest.approx(np.sqrt((w * r * r).sum() / w.sum()), rel=1e-2)


@pytest.mark.parametrize("every", [1, 3])
def test_counts_and_sums_against_a_slow_twin(every: int) -> None:
    rng = np.random.default_rng(4)
    local_map, pose, scale, facing, alike = map_of(box_points()), np.array([0.1, -0.2, 0.3]), 0.04, 0.3, 0.7
    points, angles = rng.uniform(-9.0, 9.0, (400, 2)), rng.uniform(-np.pi, np.pi, 400)
    points[:250] = seen_from(box_points(0.05), pose).points[rng.integers(0, 180, 250)]
    normals = np.c_[np.cos(angles), np.sin(angles)] * (rng.random(400) < 0.7)[:, None]
    field, hessian, moved = local_map.fine, np.empty((3, 3)), np.empty(3)
    reference = (local_map.surfels, field.nearest, field.origin, field.cell)
    widths, ones = (scale, scale, 0, 0.0), np.ones(len(points))
    got = kernels.refine(points, normals, ones, every, pose, *reference, *widths, facing, alike, moved, hessian)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    R = np.array([[c, -s], [s, c]])
    r, J = [], []
    for point, normal in zip(points[::every], normals[::every], strict=True):
        column, row = np.floor((pose[:2] + R @ point - field.origin) / field.cell).astype(int)
        is_inside = 0 <= column < field.nearest.shape[1] and 0 <= row < field.nearest.shape[0]
        k = field.nearest[row, column] if is_inside else -1
        if k < 0 or (normal.any() and R @ normal @ local_map.surfels[k, 2:] < facing):
            continue
        mx, my = local_map.surfels[k, 2:]
        x, y = R @ point
        r.append(local_map.surfels[k, 2:] @ (pose[:2] + R @ point - local_map.surfels[k, :2]))
        tells = not normal.any() or R @ normal @ local_map.surfels[k, 2:] >= alike
        tells = tells and not is_beyond(pose[:2] + R @ point, k, local_map)
        J.append((mx, my, my * x - mx * y) if tells else (0.0, 0.0, 0.0))
    residual, jacobian = np.array(r), np.array(J)
    w = 1.0 / (1.0 + (residual / scale) ** 2)
    assert got[:2] == (int((np.abs(residual) < 2 * scale).sum()), len(residual))
    assert got[2:] == pytest.approx((w.sum(), np.sqrt((w * residual**2).sum() / w.sum())), rel=1e-9)
    np.testing.assert_allclose(hessian, (jacobian * w[:, None]).T @ jacobian, rtol=1e-9)
    np.testing.assert_array_equal(moved, pose)


def test_the_hessian_by_finite_differences() -> None:
    local_map, pose = map_of(box_points()), np.array([0.02, -0.01, 0.01])
    scan = box_points(noise=0.005)
    got = evaluate_points(scan, local_map, pose, RefinementConfig())
    steps = np.eye(3) * 1e-6
    J = np.stack([(residuals(pose + h, scan) - residuals(pose - h, scan)) / 2e-6 for h in steps], axis=1)
    w = 1 / (1 + (residuals(pose, scan) / 0.04) ** 2)
    np.testing.assert_allclose(got.hessian, (J * w[:, None]).T @ J, rtol=2e-3, atol=1e-3)
    np.testing.assert_array_equal(got.T_ref_cur, pose)


def test_the_wide_stage_brings_what_the_fine_one_cannot() -> None:
    local_map, true = map_of(box_points()), np.array([0.8, 0.7, 0.3])
    scan = seen_from(box_points(), true)
    wide = refine_on_points(scan, local_map, np.zeros(3), RefinementConfig(), wide=True)
    np.testing.assert_allclose(wide.T_ref_cur, true, atol=2e-3)
    narrow = refine_on_points(scan, local_map, np.zeros(3), RefinementConfig(), wide=False)
    assert np.abs(narrow.T_ref_cur - true).max() > 0.1


def test_a_prior_holds_what_the_points_leave_open() -> None:
    both = box_points()
    wall = ScanPoints(
        points=both.points[:60], normals=both.normals[:60], beams=both.beams[:60], spreads=both.spreads[:60]
    )
    start = np.array([0.05, 0.05, 0.0])
    got = refine_on_points(wall, map_of(wall), start, RefinementConfig(), wide=False, prior_weight=1.0)
    assert got.T_ref_cur[0] == pytest.approx(0.05, abs=5e-3)
    assert got.T_ref_cur[1] == pytest.approx(0.0, abs=5e-3)


def test_surfaces_seen_from_behind_are_no_partners() -> None:
    scan = box_points()
    turned = replace(scan, normals=-scan.normals)
    assert evaluate_points(turned, map_of(scan), np.zeros(3), RefinementConfig()).used == 0
    assert evaluate_points(scan, map_of(scan), np.zeros(3), RefinementConfig()).used == 180


symmetric = st.lists(st.floats(-100, 100), min_size=9, max_size=9).map(
    lambda v: np.array(v).reshape(3, 3) + np.array(v).reshape(3, 3).T
)
vector = st.lists(st.floats(-10, 10), min_size=3, max_size=3).map(np.array)


@given(symmetric)
def test_principal_axes_against_numpy(matrix: F64) -> None:
    values, axes = np.empty(3), np.empty((3, 3))
    principal_axes(matrix, values, axes)
    np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(matrix), atol=1e-8)
    np.testing.assert_allclose(axes @ np.diag(values) @ axes.T, matrix, atol=1e-8)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-10)


@given(symmetric, vector, vector, vector)
def test_steps_solve_the_normal_equations(matrix: F64, gradient: F64, pose: F64, start: F64) -> None:
    positive = matrix @ matrix.T + np.eye(3)
    step = np.empty(3)
    assert solve_step(positive, gradient, 0.5, pose, start, step)
    expected = np.linalg.solve(positive + 0.5 * np.eye(3), -gradient - 0.5 * (pose - start))
    np.testing.assert_allclose(step, expected, rtol=1e-5, atol=1e-7)
    assert not solve_step(np.zeros((3, 3)), gradient, 0.0, pose, start, step)


@given(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_features_alone_find_the_pose(x: float, y: float, heading: float) -> None:
    true = np.array([x, y, heading])
    rows = np.zeros((4, 10))
    rows[:, :2] = [[2, 2], [2, -2], [-2, 2], [4, 0]]
    rows[:, 2:4] = [[0.1, 1.7], [1.0, 2.5], [-2.0, -0.4], [3.0, -1.7]]
    rows[:, [4, 6]], rows[:, 7], rows[:, 9] = 1e-4, 1e-4, 3.0
    reference = FeatureRows(kinds=np.full(4, CORNER, np.int8), rows=rows)
    seen = rows.copy()
    seen[:, :2] = compose(inverse(true), np.c_[rows[:, :2], np.zeros(4)])[:, :2]
    seen[:, 2:4] -= heading
    pose, hit = polish_on_features(FeatureRows(kinds=reference.kinds, rows=seen), reference, np.zeros(3))
    assert hit == 4
    np.testing.assert_allclose(between(true, pose), 0.0, atol=1e-6)
