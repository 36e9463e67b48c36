"""Points, normals, noise and segments of a scan against slow twins and closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.se2 import transform_points
from iceg.ice import _feature_kernels as kernels
from iceg.ice._noise_kernels import RangeNoise, range_noise
from iceg.ice._normal_kernels import Evenness
from iceg.ice.config import IceConfigError, SegmentConfig
from iceg.ice.points import ScanPoints, extract_points, thinned_points
from iceg.ice.segments import extract_segments, segment_rows, smoothed_on_segments
from tests.kernels import from_python

F64 = NDArray[np.float64]
BEARINGS = np.radians(np.arange(-90.0, 91.0))
ROOM = np.array([[-3.0, -2.0, 4.0, -2.0], [4.0, -2.0, 4.0, 3.0], [4.0, 3.0, -3.0, 3.0], [-3.0, 3.0, -3.0, -2.0]])


def cast(walls: F64, pose: F64) -> F64:
    """Ranges to the nearest wall (x0, y0, x1, y1) from a pose; NaN beyond 20 m."""
    angles = BEARINGS + pose[2]
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None, :]
    start, along = walls[None, :, :2] - pose[:2], walls[None, :, 2:] - walls[None, :, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        det = ray[..., 1] * along[..., 0] - ray[..., 0] * along[..., 1]
        r = (start[..., 1] * along[..., 0] - start[..., 0] * along[..., 1]) / det
        t = (ray[..., 0] * start[..., 1] - ray[..., 1] * start[..., 0]) / det
        r = np.where((t >= 0) & (t <= 1) & (r > 0) & (r < 20), r, np.nan)
    return np.where(np.isnan(r).all(axis=1), np.nan, np.nanmin(np.where(np.isnan(r), np.inf, r), axis=1))


def scan_of(walls: F64, pose: F64, noise: F64 | float = 0.0, mount: F64 | None = None) -> Scan:
    geometry = ScanGeometry(
        bearings=BEARINGS, range_min=0.0, range_max=20.0, T_robot_laser=np.zeros(3) if mount is None else mount
    )
    return Scan(ranges=(cast(walls, pose) + noise).astype(np.float32), geometry=geometry)


def test_points_of_beams_without_return_are_left_out() -> None:
    scan = scan_of(ROOM, np.zeros(3))
    scan.ranges[[3, 50, 180]] = np.nan
    points = extract_points(scan)
    np.testing.assert_allclose(points.points, scan.points, atol=1e-6)
    assert len(points) == 178
    assert set(points.beams.tolist()) == set(range(181)) - {3, 50, 180}


def test_thinned_points_are_some_of_all_points() -> None:
    rng = np.random.default_rng(1)
    mounts = (np.zeros(3), np.array([0.2, -0.1, 0.5]))  # two lasers
    scans = [scan_of(ROOM, rng.normal(0, 0.3, 3), rng.normal(0, 0.02, 181), mounts[k > 3]) for k in range(7)]
    for scan in scans[1:]:
        scan.ranges[rng.integers(0, 181, 40)] = np.nan
    scans[2].ranges[:] = np.nan
    offsets = np.arange(7) % 3
    thinned = thinned_points(scans, offsets, 3, Evenness(roughness=1.0, factor=1e6))
    starts = thinned.starts
    for k, scan in enumerate(scans):
        every = extract_points(scan)
        np.testing.assert_array_equal(thinned.points[starts[k] : starts[k + 1]], every.points[offsets[k] :: 3])
        whole, normals = every.normals[offsets[k] :: 3], thinned.normals[starts[k] : starts[k + 1]]
        is_line = whole.any(axis=1)  # elsewhere a part of the neighbourhood may be one
        np.testing.assert_array_equal(normals[is_line], whole[is_line])
        assert ((normals[~is_line] ** 2).sum(axis=1).round(12) % 1.0 == 0.0).all()
    assert starts[-1] == len(thinned.points) == len(thinned.normals) == len(thinned.spreads) == len(thinned.errors)
    assert (thinned.spreads == 1.0).all()
    assert (thinned.errors == 0.0).all()


def test_at_a_step_of_a_wall_one_of_its_surfaces_gives_the_normal() -> None:
    niche = np.array([[-8.0, 2.0, 0.5, 2.0], [0.5, 2.0, 0.5, 2.15], [0.5, 2.15, 1.5, 2.15], [1.5, 2.15, 1.5, 2.0]])
    walls = np.vstack([niche, [[1.5, 2.0, 8.0, 2.0]]])
    noise = RangeNoise(constant=1e-4, per_metre2=0.0, allowed=6e-4, typical=0.0)
    rng = np.random.default_rng(2)
    x = np.arange(-2.0, 4.0, 0.3)
    scans = [scan_of(walls, np.array([at, 0.0, np.pi / 2]), rng.normal(0, 0.01, 181)) for at in x]

    def turned(even: Evenness) -> tuple[F64, F64]:
        """By how much normals are turned from the wall's, beside a step and elsewhere; NaN without one [rad]."""
        seen = thinned_points(scans, np.zeros(len(scans), np.int64), 1, even, noise=noise)
        along = np.repeat(x, np.diff(seen.starts)) - seen.points[:, 1]
        off = np.where(seen.normals.any(axis=1), np.abs(np.arctan2(seen.normals[:, 1], -seen.normals[:, 0])), np.nan)
        is_near, to_step = np.hypot(*seen.points.T) < 4.0, np.minimum(np.abs(along - 0.5), np.abs(along - 1.5))
        return off[is_near & (to_step < 0.1)], off[is_near & (to_step > 0.3)]

    def slantwise(off: F64) -> float:
        return float(np.mean(np.abs(off - 0.45) < 0.25))

    whole, elsewhere = turned(Evenness(roughness=1.0, factor=1e6))
    parts, elsewhere_too = turned(Evenness(roughness=0.005, factor=2.5))
    assert slantwise(whole) > 0.5
    assert slantwise(parts) < 0.05
    assert np.mean(np.isfinite(parts)) > 0.8
    assert np.mean(np.isnan(elsewhere_too)) < 0.02
    assert np.nanmedian(elsewhere_too) < 1.05 * np.nanmedian(elsewhere)


def test_normals_against_a_slow_twin() -> None:
    scan = scan_of(ROOM, np.array([0.3, 0.1, 0.2]), np.random.default_rng(0).normal(0, 0.01, 181))
    got = extract_points(scan, reach=0.2)
    p = got.points
    for i in range(2, len(p) - 2):
        first = i
        while first > 0 and i - first < 12 and (i - first < 2 or np.hypot(*(p[first] - p[i])) < 0.2):
            first -= 1
        last = i
        while last < len(p) - 1 and last - i < 12 and (last - i < 2 or np.hypot(*(p[last] - p[i])) < 0.2):
            last += 1
        values, vectors = np.linalg.eigh(np.cov(p[first : last + 1].T, bias=True))
        normal = vectors[:, 0] if vectors[:, 0] @ p[i] < 0 else -vectors[:, 0]
        if values[0] > 0.1 * values[1]:
            assert not got.normals[i].any()
        else:
            np.testing.assert_allclose(got.normals[i], normal, atol=1e-5)


def test_normals_stop_at_a_jump() -> None:
    walls = np.array([[2.0, -5.0, 2.0, 0.0], [4.0, 0.0, 4.0, 5.0]])
    points = extract_points(scan_of(walls, np.zeros(3)))
    np.testing.assert_allclose(points.normals, np.tile([-1.0, 0.0], (len(points), 1)), atol=1e-4)


def test_the_ends_of_what_a_laser_sees_on_either_side_are_no_wall_ahead() -> None:
    bearings = np.radians(np.linspace(-40.0, 40.0, 321))
    with np.errstate(divide="ignore"):
        ranges = np.where(bearings > 0.0, 1.2, 0.8) / np.abs(np.sin(bearings))
    ranges[ranges > 4.0] = np.nan
    geometry = ScanGeometry(bearings=bearings, range_min=0.05, range_max=4.0)
    seen = extract_points(Scan(ranges=ranges.astype(np.float32), geometry=geometry))
    np.testing.assert_allclose(seen.normals[:, 0], 0.0, atol=1e-3)
    np.testing.assert_allclose(seen.normals[:, 1], -np.sign(seen.points[:, 1]), atol=1e-5)


def test_a_few_beams_that_did_not_return_leave_a_wall_whole() -> None:
    wall = np.array([[2.0, -5.0, 2.0, 5.0]])
    scan = scan_of(wall, np.zeros(3))
    scan.ranges[[88, 89, 92]] = np.nan
    normals = extract_points(scan).normals
    np.testing.assert_allclose(normals, np.tile([-1.0, 0.0], (len(normals), 1)), atol=1e-4)


def test_what_is_too_slim_for_a_line_faces_the_laser_if_it_stands_before_its_neighbours() -> None:
    ranges = np.full(181, 8.0)
    ranges[:100] = np.where(np.arange(100) % 2, 12.0, 16.0)  # no line
    ranges[[19, 21]], ranges[20] = np.nan, 3.0  # a post, nothing beside it
    ranges[60], ranges[61] = 5.0, 5.05  # a trunk
    ranges[100] = 8.9  # a gap in a wall
    ranges[140], ranges[141:150], ranges[150:] = 6.0, 4.0, np.nan  # a beam that met two walls
    geometry = ScanGeometry(bearings=BEARINGS, range_min=0.0, range_max=20.0, T_robot_laser=np.array([0.2, 0.1, 0.3]))
    scan = Scan(ranges=ranges.astype(np.float32), geometry=geometry)
    got = extract_points(scan)
    normals = dict(zip(got.beams.tolist(), got.normals, strict=True))
    for beam in (20, 60, 61):
        np.testing.assert_allclose(normals[beam], -geometry.directions_robot[beam], atol=1e-6)
    assert not normals[100].any()
    assert not normals[140].any()
    ranges[:60], ranges[62:100] = 8.0, 8.0
    walls = extract_points(Scan(ranges=ranges.astype(np.float32), geometry=geometry))
    assert not walls.normals[60:62].any()


def noise_of(points: ScanPoints) -> float:
    return float(range_noise(points.points, points.beams))


@pytest.mark.parametrize("sigma", [0.002, 0.01, 0.03])
def test_noise_is_estimated_from_the_scan(sigma: float) -> None:
    # Walls seen head-on: the noise of the ranges is the noise across the wall.
    angles = np.linspace(-0.5, 0.5, 180)
    geometry = ScanGeometry(bearings=angles, range_min=0.0, range_max=20.0)
    ranges = 3.0 / np.cos(angles) + np.random.default_rng(1).normal(0, sigma, 180)
    points = extract_points(Scan(ranges=ranges.astype(np.float32), geometry=geometry))
    assert noise_of(points) == pytest.approx(sigma, rel=0.25)


def test_without_noise_there_is_none_whatever_the_incidence() -> None:
    assert noise_of(extract_points(scan_of(ROOM, np.array([3.5, 0.0, 0.4])))) < 1e-5
    empty = scan_of(ROOM, np.zeros(3))
    empty.ranges[:] = np.nan
    assert noise_of(extract_points(empty)) == 0.0


def test_line_fit_is_total_least_squares_with_its_covariance() -> None:
    rng = np.random.default_rng(2)
    t = np.linspace(-1.0, 2.0, 30)
    heading, sigma = 0.7, 0.02
    direction, normal = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    row, angles, offsets, claimed = np.empty(kernels.SEGMENT_COLUMNS), [], [], []
    fit_line = from_python(kernels._fit_line)
    for _ in range(2000):
        points = np.array([1.0, 2.0]) + t[:, None] * direction + rng.normal(0, sigma, (30, 1)) * normal
        fit_line(points, 0, 29, sigma, row)
        angles.append(np.arctan2(row[kernels.TY], row[kernels.TX]))
        offsets.append((row[:2] - [1.0, 2.0]) @ normal)
        claimed.append(row[[kernels.V_OFFSET, kernels.V_ANGLE]].copy())
    centered = points - points.mean(axis=0)
    twin = np.linalg.svd(centered)[2][0]
    twin *= np.sign(twin @ direction)
    np.testing.assert_allclose(row[2:4], twin, atol=1e-9)
    assert np.mean(angles) == pytest.approx(heading, abs=1e-3)
    # Closed form: σ²/Σt² for the angle, σ²/n for the offset at the centroid.
    assert np.var(angles) == pytest.approx(sigma**2 / ((t - t.mean()) ** 2).sum(), rel=0.12)
    assert np.var(offsets) == pytest.approx(sigma**2 / 30, rel=0.12)
    # The claim takes the larger of the given and the seen spread, hence a little more.
    assert np.mean(claimed, axis=0) == pytest.approx([np.var(offsets), np.var(angles)], rel=0.25)


def test_a_room_is_cut_into_its_walls() -> None:
    segments = extract_segments(scan_of(ROOM, np.zeros(3)))
    assert len(segments) == 3
    np.testing.assert_allclose(np.abs(segments.headings), [0.0, np.pi / 2, np.pi], atol=1e-3)
    np.testing.assert_allclose(segments.endpoints[1], [[4.0, -2.0], [4.0, 3.0]], atol=0.08)
    assert (np.diff(segments.point_ranges.ravel()) >= 0).all()


def test_a_gap_and_missing_beams_part_two_segments() -> None:
    walls = np.array([[3.0, -3.0, 3.0, -0.5], [3.0, 0.5, 3.0, 3.0]])
    assert len(extract_segments(scan_of(walls, np.zeros(3)))) == 2
    whole = np.array([[3.0, -3.0, 3.0, 3.0]])
    scan = scan_of(whole, np.zeros(3))
    assert len(extract_segments(scan)) == 1
    scan.ranges[88:93] = np.nan
    assert len(extract_segments(scan)) == 2


def test_merging_heals_a_wall_that_the_split_cut() -> None:
    # Ends too near tilt nothing, but the middle then lies farther from the chord than a point may from its line.
    scan = scan_of(np.array([[3.0, -1.0, 3.0, 1.0]]), np.zeros(3))
    hit = np.flatnonzero(np.isfinite(scan.ranges))
    scan.ranges[hit[[0, -1]]] -= 0.025
    scan.ranges[90] += 0.015
    points = extract_points(scan)
    assert from_python(kernels._farthest_from_chord)(points.points, 0, len(points) - 1)[0] > 0.03
    assert len(segment_rows(scan, SegmentConfig(split_sigmas=0.0, split=0.03), points)) == 1


def test_walls_stay_whole_on_a_noisy_laser() -> None:
    noise = np.random.default_rng(3).normal(0, 0.03, 181)
    scan = scan_of(ROOM, np.zeros(3), noise)
    assert len(extract_segments(scan)) <= 6
    assert len(extract_segments(scan, SegmentConfig(split_sigmas=0.0))) > 10


def test_points_of_walls_are_put_onto_them() -> None:
    scan = scan_of(ROOM, np.zeros(3), np.random.default_rng(4).normal(0, 0.008, 181))
    points = extract_points(scan)
    rows = segment_rows(scan, SegmentConfig(), points)
    smooth = smoothed_on_segments(points, rows, scan.geometry.origin_robot, SegmentConfig())
    for row in rows:
        first, last = int(row[kernels.I_FIRST]), int(row[kernels.I_LAST])
        normal = np.array([-row[kernels.TY], row[kernels.TX]])
        np.testing.assert_allclose((smooth.points[first + 1 : last] - row[:2]) @ normal, 0.0, atol=1e-9)
        assert ((smooth.normals[first : last + 1] * smooth.points[first : last + 1]).sum(axis=1) < 0).all()
    assert np.abs(smooth.points - points.points).max() < 0.05


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3.0, 3.0))
def test_segments_turn_with_the_mount_of_the_laser(x: float, y: float, heading: float) -> None:
    mount = np.array([x, y, heading])
    pose = np.array([0.2, -0.3, 0.1])
    plain, mounted = extract_segments(scan_of(ROOM, pose)), extract_segments(scan_of(ROOM, pose, mount=mount))
    assert len(plain) == len(mounted)
    np.testing.assert_allclose(mounted.endpoints, transform_points(mount, plain.endpoints), atol=1e-6)
    np.testing.assert_allclose(mounted.heading_variances, plain.heading_variances, rtol=1e-4)


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(IceConfigError, match="found min_points 1, expected a number from 2"):
        SegmentConfig(min_points=1)


@pytest.mark.parametrize(("radius", "sigma", "most"), [(6.0, 0.0, 0.004), (6.0, 0.01, 0.006), (np.inf, 0.01, 0.006)])
def test_walls_that_bend_are_smoothed_onto_their_curve(radius: float, sigma: float, most: float) -> None:
    """A wall 2 m to the left, round about a point on that side or straight."""
    bearings = np.radians(np.linspace(50.0, 130.0, 201))
    beams = np.column_stack([np.cos(bearings), np.sin(bearings)])
    if np.isinf(radius):
        ranges, inwards = 2.0 / beams[:, 1], np.tile([0.0, -1.0], (len(beams), 1))
    else:  # the nearer intersection with the circle about (0, 2 + radius)
        height = 2.0 + radius
        ranges = height * beams[:, 1] - np.sqrt(radius**2 - height**2 * beams[:, 0] ** 2)
        inwards = (ranges[:, None] * beams - [0.0, height]) / radius
    on_wall = ranges[:, None] * beams
    noisy = ranges + np.random.default_rng(0).normal(0.0, sigma, len(ranges)) if sigma else ranges
    geometry = ScanGeometry(bearings=bearings, range_min=0.05, range_max=20.0)
    scan, config = Scan(ranges=noisy.astype(np.float32), geometry=geometry), SegmentConfig()
    points = extract_points(scan)
    smoothed = smoothed_on_segments(points, segment_rows(scan, config, points), np.zeros(2), config)
    off = np.vecdot(smoothed.points - on_wall[smoothed.beams], inwards[smoothed.beams])
    assert np.sqrt(np.mean(off**2)) < most
    turned = np.vecdot(smoothed.normals, inwards[smoothed.beams])
    assert np.degrees(np.arccos(np.clip(turned, -1.0, 1.0))).mean() < 1.5
