"""The local map: surfels, nearest fields, merged features, and what of it a scan sees."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from iceg.ice import _agreement_kernels as kernels
from iceg.ice.config import FeatureConfig, IceConfigError, LocalMapConfig, RefinementConfig
from iceg.ice.features import CORNER, END_OF_WALL, FeatureRows
from iceg.ice.local_map import LocalMap, box_around
from iceg.ice.matcher import IceMatcher
from iceg.ice.points import ScanPoints
from iceg.ice.verification import Agreement, view

F64 = NDArray[np.float64]
NO_FEATURES = FeatureRows(kinds=np.empty(0, np.int8), rows=np.empty((0, 10)))
LOWER, UPPER = np.array([-4.0, -3.0]), np.array([5.0, 4.0])


def cloud(n: int, seed: int) -> ScanPoints:
    rng = np.random.default_rng(seed)
    angles = rng.choice([0.3, 0.3 + np.pi, 2.0], n)
    return ScanPoints(
        points=rng.uniform(-2, 2, (n, 2)),
        normals=np.c_[np.cos(angles), np.sin(angles)],
        beams=np.arange(n, dtype=np.int32),
        spreads=np.ones(n),
    )


def local_map_of(*scans: ScanPoints, poses: F64 | None = None) -> LocalMap:
    local_map = LocalMap(LOWER, UPPER, LocalMapConfig(), FeatureConfig())
    for scan_points, pose in zip(scans, np.zeros((len(scans), 3)) if poses is None else poses, strict=True):
        local_map.add(scan_points, NO_FEATURES, pose)
    return local_map


def test_surfels_are_means_of_a_cell_and_a_facing() -> None:
    scans, poses = (cloud(300, 0), cloud(300, 1)), np.array([[0.0, 0.0, 0.0], [0.5, -0.3, 0.7]])
    local_map = local_map_of(*scans, poses=poses)
    groups: dict[tuple[int, int], list[list[F64]]] = {}
    for scan_points, pose in zip(scans, poses, strict=True):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        R = np.array([[c, -s], [s, c]])
        for p, n in zip(pose[:2] + scan_points.points @ R.T, scan_points.normals @ R.T, strict=True):
            cell = tuple(np.floor((p - LOWER) / 0.1).astype(int).tolist())
            facings = groups.setdefault(cell, [])
            for group in facings:
                if np.mean(group, axis=0)[2:] @ n > 0.6:
                    group.append(np.r_[p, n])
                    break
            else:
                if len(facings) < 2:
                    facings.append([np.r_[p, n]])
    expected = np.array([np.mean(group, axis=0) for facings in groups.values() for group in facings])
    expected[:, 2:] /= np.linalg.norm(expected[:, 2:], axis=1, keepdims=True)
    got = local_map.surfels
    np.testing.assert_allclose(got[np.lexsort(got.T)], expected[np.lexsort(expected.T)], atol=1e-9)


def test_a_map_that_made_room_is_one_that_had_it() -> None:
    scans, poses = (cloud(200, 0), cloud(200, 1)), np.array([[0.0, 0.0, 0.0], [6.3, -5.2, 0.7]])
    had = LocalMap(LOWER - 8.0, UPPER + 8.0, LocalMapConfig(), FeatureConfig())
    made = LocalMap(LOWER, UPPER, LocalMapConfig(), FeatureConfig())
    for scan_points, pose in zip(scans, poses, strict=True):
        made.make_room(scan_points, pose, 2.0)
        for local_map in (had, made):
            local_map.add(scan_points, NO_FEATURES, pose)
    np.testing.assert_array_equal(made.surfels, had.surfels)
    for ours, theirs in ((made.fine, had.fine), (made.coarse, had.coarse)):
        left, below = np.round((ours.origin - theirs.origin) / ours.cell).astype(int)
        rows, columns = ours.nearest.shape
        inside = np.s_[below : below + rows, left : left + columns]
        np.testing.assert_array_equal(ours.nearest, theirs.nearest[inside])
        np.testing.assert_array_equal(ours.distance2, theirs.distance2[inside])


def test_a_map_with_room_enough_stays_as_it_is() -> None:
    local_map = local_map_of(cloud(200, 0))
    before = local_map.fine
    far = ScanPoints(
        points=np.array([[0.5, 0.2]]), normals=np.array([[1.0, 0.0]]), beams=np.zeros(1, np.int32), spreads=np.ones(1)
    )
    local_map.make_room(far, np.array([1.0, 1.0, 0.0]), 2.0)
    assert local_map.fine is before


def test_the_fields_hold_the_nearest_surfel() -> None:
    local_map = local_map_of(cloud(150, 2))
    field, surfels = local_map.fine, local_map.surfels
    ny, nx = field.nearest.shape
    assert (nx, ny) == (90, 70)
    x, y = field.origin[0] + (np.arange(nx) + 0.5) * field.cell, field.origin[1] + (np.arange(ny) + 0.5) * field.cell
    d2 = (x[None, :, None] - surfels[:, 0]) ** 2 + (y[:, None, None] - surfels[:, 1]) ** 2
    near = d2.min(axis=2) <= field.radius**2
    np.testing.assert_array_equal(field.nearest >= 0, near)
    np.testing.assert_array_equal(field.nearest[near], d2.argmin(axis=2)[near])
    np.testing.assert_allclose(field.distance2[near], d2.min(axis=2)[near], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(field.distance2[~near], field.radius**2)


def test_points_outside_the_box_and_without_normal_do_not_enter() -> None:
    scan_points = ScanPoints(
        points=np.array([[0.0, 0.0], [9.0, 0.0], [1.0, 1.0]]),
        normals=np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 0.0]]),
        beams=np.arange(3, dtype=np.int32),
        spreads=np.ones(3),
    )
    assert len(local_map_of(scan_points).surfels) == 1


def test_the_map_grows_without_forgetting() -> None:
    many = [cloud(400, seed) for seed in range(15)]
    local_map = local_map_of(*many)
    assert len(local_map.surfels) > 2500
    assert np.isfinite(local_map.surfels).all()


def feature(kind: int, x: float, y: float, a: float, b: float, real: float = 1.0, distance: float = 3.0) -> FeatureRows:
    return FeatureRows(
        kinds=np.array([kind], np.int8), rows=np.array([[x, y, a, b, 4e-4, 0.0, 1e-4, 1e-3, real, distance]])
    )


def test_features_seen_again_are_merged() -> None:
    local_map = LocalMap(LOWER, UPPER, LocalMapConfig(), FeatureConfig(merge_radius=0.25))
    none = cloud(0, 0)
    local_map.add(none, feature(CORNER, 1.0, 0.0, 3.1, 1.5), np.zeros(3))
    local_map.add(none, feature(CORNER, 1.1, 0.0, -3.1, 1.5, distance=2.0), np.zeros(3))
    merged = local_map.features
    assert len(merged) == 1
    np.testing.assert_allclose(merged.positions, [[1.05, 0.0]])
    assert abs(merged.directions[0, 0]) == pytest.approx(np.pi, abs=1e-9)
    assert merged.distances[0] == 2.0
    for other in (
        feature(CORNER, 1.4, 0.0, 3.1, 1.5),
        feature(END_OF_WALL, 1.0, 0.0, 3.1, np.nan),
        feature(CORNER, 1.0, 0.0, 2.5, 1.5),
    ):
        before = len(local_map.features)
        local_map.add(none, other, np.zeros(3))
        assert len(local_map.features) == before + 1


def test_features_turn_into_the_frame_of_the_map() -> None:
    local_map = LocalMap(LOWER, UPPER, LocalMapConfig(), FeatureConfig())
    local_map.add(cloud(0, 0), feature(END_OF_WALL, 1.0, 0.0, np.nan, 0.2), np.array([1.0, 2.0, np.pi / 2]))
    features = local_map.features
    np.testing.assert_allclose(features.positions, [[1.0, 3.0]], atol=1e-12)
    np.testing.assert_allclose(features.directions, [[np.nan, 0.2 + np.pi / 2]])
    np.testing.assert_allclose(features.covariances[0], np.diag([1e-4, 4e-4]), atol=1e-12)


def test_the_box_holds_the_points_within_reach() -> None:
    points = [np.array([[1.0, 0.0], [60.0, 0.0]]), np.array([[0.0, 2.0]]), np.empty((0, 2))]
    poses = np.array([[0.0, 0.0, np.pi / 2], [5.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    lower, upper = box_around(points, poses, reach=10.0, margin=1.0)
    assert lower.tolist() == [-1.0, -1.0]
    assert upper.tolist() == [6.0, 11.0]


@pytest.mark.parametrize(("n_far", "reached"), [(0, 25.0), (10, 25.0), (11, 38.0)])
def test_a_box_reaches_as_far_as_a_scan_sees_where_much_of_it_is_far(n_far: int, reached: float) -> None:
    near = np.column_stack([np.linspace(1.0, 20.0, 30), np.zeros(30)])
    before = np.array([[0.0, -70.0], [0.0, 70.0]])
    points = [before, np.r_[near, np.tile([[0.0, 38.0]], (n_far, 1))]]
    lower, upper = box_around(points, np.zeros((2, 3)), reach=25.0, margin=0.0)
    assert (lower.tolist(), upper.tolist()) == ([0.0, -reached], [20.0, reached])


def wall_at(x: float) -> F64:
    y = np.linspace(-2.95, 2.95, 60)
    return np.stack([np.full(60, x), y, np.full(60, -1.0), np.zeros(60)], axis=1)


def test_a_scan_sees_looks_through_or_cannot_judge_the_reference() -> None:
    bearings = np.radians(np.arange(-90.0, 91.0))
    depth = 3.0 / np.maximum(np.cos(bearings), 1e-3)
    ranges = np.where(depth < 15, depth, np.nan).astype(np.float32)

    def count(surfels: F64, pose: F64, seen: NDArray[np.float32] = ranges) -> tuple[int, int]:
        agree, contradict = kernels.visible_agreement(
            surfels, pose, np.zeros(3), bearings[0], bearings[1] - bearings[0], seen, 8.0, 0.2
        )
        return agree, contradict

    assert count(wall_at(3.0), np.zeros(3)) == (60, 0)
    assert count(wall_at(2.0), np.zeros(3))[0] == 0
    assert count(wall_at(2.0), np.zeros(3))[1] > 50
    # What lies behind a surface, turns its back, is too far or lies outside the field of view says nothing.
    assert count(wall_at(5.0), np.zeros(3)) == (0, 0)
    assert count(wall_at(2.0) * [1, 1, -1, 1], np.zeros(3)) == (0, 0)
    assert count(wall_at(3.0), np.array([-7.0, 0.0, 0.0])) == (0, 0)
    assert count(wall_at(3.0), np.array([0.0, 0.0, np.pi])) == (0, 0)
    # Nothing but silence where the beams did not return.
    assert count(wall_at(2.0), np.zeros(3), np.full(181, np.nan, np.float32)) == (0, 0)
    # The same from anywhere, the wall seen where it is.
    assert count(wall_at(3.5), np.array([0.5, 0.0, 0.0])) == (60, 0)


def test_the_mount_of_the_laser_counts() -> None:
    bearings = np.radians(np.arange(-90.0, 91.0))
    mount = np.array([0.4, -0.2, np.pi / 2])
    depth = 3.0 / np.maximum(np.cos(bearings), 1e-3)
    ranges = np.where(depth < 15, depth, np.nan).astype(np.float32)
    geometry = ScanGeometry(bearings=bearings, range_min=0.0, range_max=20.0, T_robot_laser=mount)
    # The laser looks to the left of the robot: the wall it sees at 3 m lies at y = 2.8.
    x = np.linspace(-1.5, 1.5, 30)
    scan_points = ScanPoints(
        points=np.c_[x, np.full(30, 2.8)],
        normals=np.tile([0.0, -1.0], (30, 1)),
        beams=np.arange(30, dtype=np.int32),
        spreads=np.ones(30),
    )
    seen, contradicted = view(
        Scan(ranges=ranges, geometry=geometry), local_map_of(scan_points), np.zeros(3), RefinementConfig()
    )
    assert seen >= 28
    assert contradicted == 0


def test_agreements_add_up() -> None:
    one = Agreement(points=10, known=8, inliers=6, seen=3, contradicted=1)
    both = one + one
    assert (both.overlap, both.fit, both.view) == (0.8, 0.75, 0.75)
    assert (Agreement().overlap, Agreement().fit) == (0.0, 0.0)
    assert Agreement().view == 1.0, "where nothing is in view nothing is contradicted"


def test_scans_placed_in_several_ways_are_judged_as_each_way_alone() -> None:
    bearings = np.radians(np.arange(-90.0, 91.0))
    geometry = ScanGeometry(bearings=bearings, range_min=0.0, range_max=20.0, T_robot_laser=np.zeros(3))
    depth = (2.0 / np.maximum(np.cos(bearings), 0.1)).astype(np.float32)
    scans = [Scan(ranges=depth, geometry=geometry), Scan(ranges=depth + np.float32(0.5), geometry=geometry)]
    matcher = IceMatcher()
    reference = matcher.prepare([scans[0]], np.zeros((1, 3)))
    placements = np.random.default_rng(0).normal(0.0, [0.5, 0.5, 0.3], (6, 2, 3))
    placements[0] = [[0.0, 0.0, 0.0], [-0.5, 0.0, 0.0]]
    alone = [matcher.agreement_of_all(reference, scans, poses) for poses in placements]
    assert matcher.agreements(reference, matcher.join(scans), placements) == alone
    strict = matcher.agreements(reference, matcher.join(scans), placements, 0.5, 0.7)
    fits = [one.overlap >= 0.5 and one.fit >= 0.7 for one in alone]
    assert fits[0]
    assert not all(fits)
    for fit, one, other in zip(fits, alone, strict, strict=True):
        assert other == (one if fit else replace(one, seen=0, contradicted=0))


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(IceConfigError, match="coarse_cell"):
        LocalMapConfig(cell=0.3)
