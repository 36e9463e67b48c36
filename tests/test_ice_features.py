"""Corners, ends of walls and intersections: where they are, how well they are known, and which are real."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.se2 import transform_points, wrap_angle
from iceg.ice.config import FeatureConfig, IceConfigError
from iceg.ice.features import CORNER, END_OF_WALL, INTERSECTION, Features, extract_features

F64 = NDArray[np.float64]
BEARINGS = np.radians(np.arange(-90.0, 91.0))


def scan_of(walls: F64, noise: F64 | float = 0.0, mount: F64 | None = None) -> Scan:
    """What a laser at the origin sees of walls (x0, y0, x1, y1); NaN beyond 20 m."""
    ray = np.stack([np.cos(BEARINGS), np.sin(BEARINGS)], axis=1)[:, None, :]
    start, along = walls[None, :, :2], walls[None, :, 2:] - walls[None, :, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        det = ray[..., 1] * along[..., 0] - ray[..., 0] * along[..., 1]
        r = (start[..., 1] * along[..., 0] - start[..., 0] * along[..., 1]) / det
        t = (ray[..., 0] * start[..., 1] - ray[..., 1] * start[..., 0]) / det
        r = np.where((t >= 0) & (t <= 1) & (r > 0) & (r < 20), r, np.inf).min(axis=1)
    ranges = np.where(np.isfinite(r), r + noise, np.nan).astype(np.float32)
    geometry = ScanGeometry(
        bearings=BEARINGS, range_min=0.0, range_max=20.0, T_robot_laser=np.zeros(3) if mount is None else mount
    )
    return Scan(ranges=ranges, geometry=geometry)


def nearest(features: Features, position: tuple[float, float]) -> int:
    return int(np.hypot(*(features.positions - position).T).argmin())


def test_a_corner_of_two_walls() -> None:
    features = extract_features(scan_of(np.array([[1.0, 2.0, 4.0, 2.0], [4.0, 2.0, 4.0, -3.0]])))
    k = nearest(features, (4.0, 2.0))
    assert features.kinds[k] == CORNER
    np.testing.assert_allclose(features.positions[k], [4.0, 2.0], atol=0.01)
    # The wall on the clockwise side runs down, the other one to the left.
    np.testing.assert_allclose(wrap_angle(features.directions[k] - [-np.pi / 2, np.pi]), 0.0, atol=0.01)
    assert features.real[k]
    assert features.distances[k] == pytest.approx(np.hypot(4, 2), abs=0.01)


def test_covariance_of_a_corner_by_monte_carlo() -> None:
    rng = np.random.default_rng(0)
    walls = np.array([[1.0, 2.0, 4.0, 2.0], [4.0, 2.0, 4.0, -3.0]])
    positions, covariances = [], []
    for _ in range(400):
        features = extract_features(scan_of(walls, rng.normal(0, 0.015, 181)))
        k = nearest(features, (4.0, 2.0))
        if features.kinds[k] == CORNER:
            positions.append(features.positions[k])
            covariances.append(features.covariances[k])
    assert len(positions) > 250
    errors = np.array(positions) - [4.0, 2.0]
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    # 2 is right; range noise counts in full across a wall only where the beam meets it head-on.
    assert 0.6 < nees.mean() < 4.0


END = np.array([[3.0, -3.0, 3.0, 0.5]])
BACKGROUND = np.array([[6.0, -9.0, 6.0, 9.0]])
NEARER = np.array([[1.5, 0.25, 1.5, 2.0]])


def test_the_end_of_a_wall_in_front_of_another_is_real() -> None:
    features = extract_features(scan_of(np.vstack([END, BACKGROUND])))
    k = nearest(features, (3.0, 0.5))
    assert features.kinds[k] == END_OF_WALL
    assert features.real[k]
    np.testing.assert_allclose(features.positions[k], [3.0, 0.5], atol=0.06)
    # It starts at its end and runs down the wall, on the clockwise side; there is no other wall.
    np.testing.assert_allclose(features.directions[k, 0], -np.pi / 2, atol=0.01)
    assert np.isnan(features.directions[k, 1])
    assert features.covariances[k, 1, 1] < 0.05**2


@pytest.mark.parametrize("why", ["occluded", "no return behind it", "edge of the view"])
def test_an_end_nobody_sees_is_weak_and_may_slip_along_its_wall(why: str) -> None:
    if why == "occluded":
        scan, near = scan_of(np.vstack([END, BACKGROUND, NEARER])), (3.0, 0.45)
    elif why == "no return behind it":
        scan, near = scan_of(END), (3.0, 0.5)
    else:
        scan, near = scan_of(np.array([[-2.0, 3.0, 2.0, 3.0]])), (0.0, 3.0)
    features = extract_features(scan)
    k = nearest(features, near)
    assert features.kinds[k] == END_OF_WALL
    assert not features.real[k]
    along, across = (0, 1) if why == "edge of the view" else (1, 0)
    assert features.covariances[k, along, along] > 0.4**2
    assert features.covariances[k, across, across] < 0.05**2


def test_walls_that_would_meet_make_an_intersection() -> None:
    # Two walls whose extensions meet at (4, 2), one metre beyond their ends.
    features = extract_features(scan_of(np.array([[1.0, 2.0, 3.0, 2.0], [4.0, 1.0, 4.0, -3.0]])))
    k = nearest(features, (4.0, 2.0))
    assert features.kinds[k] == INTERSECTION
    np.testing.assert_allclose(features.positions[k], [4.0, 2.0], atol=0.02)
    near = extract_features(
        scan_of(np.array([[1.0, 2.0, 3.0, 2.0], [4.0, 1.0, 4.0, -3.0]])), FeatureConfig(extension=0.5)
    )
    assert INTERSECTION not in near.kinds


def test_walls_that_are_nearly_parallel_meet_nowhere() -> None:
    features = extract_features(scan_of(np.array([[2.0, -3.0, 2.5, 0.0], [2.5, 0.0, 2.8, 3.0]])))
    assert set(features.kinds.tolist()) <= {END_OF_WALL}


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3.0, 3.0))
def test_features_move_rigidly_with_the_mount(x: float, y: float, heading: float) -> None:
    walls = np.array([[1.0, 2.0, 4.0, 2.0], [4.0, 2.0, 4.0, -1.0], [6.0, -9.0, 6.0, 9.0]])
    mount = np.array([x, y, heading])
    plain, moved = extract_features(scan_of(walls)), extract_features(scan_of(walls, mount=mount))
    assert plain.kinds.tolist() == moved.kinds.tolist()
    assert plain.real.tolist() == moved.real.tolist()
    np.testing.assert_allclose(moved.positions, transform_points(mount, plain.positions), atol=1e-6)
    turned = moved.directions - plain.directions - heading
    np.testing.assert_allclose(wrap_angle(turned[np.isfinite(turned)]), 0.0, atol=1e-5)
    c, s = np.cos(heading), np.sin(heading)
    R = np.array([[c, -s], [s, c]])
    np.testing.assert_allclose(moved.covariances, R @ plain.covariances @ R.T, rtol=1e-3, atol=1e-7)


def test_an_empty_scan_has_no_features() -> None:
    assert len(extract_features(scan_of(np.array([[30.0, 0.0, 30.0, 1.0]])))) == 0


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(IceConfigError, match="min_angle"):
        FeatureConfig(min_angle=2.0)
