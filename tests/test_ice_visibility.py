"""Beams that go through what the other scan saw: against a slow twin, and as what tells two poses apart."""

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from frontends.simulator.laser import cast, sick_lms200
from frontends.simulator.world import World, polyline
from graph.measurement import RelativePose
from graph.se2 import between, compose, transform_points
from iceg.ice import _visibility_kernels as kernels
from iceg.ice.config import LocalMapConfig
from iceg.ice.matcher import IceMatcher
from iceg.ice.points import extract_points
from iceg.ice.refinement import evaluate_points
from iceg.ice.sweeps import sweeps_of
from iceg.ice.verification import Agreement, contradictions, view

F64 = NDArray[np.float64]
REACH, MARGIN, ACROSS, CELL = 20.0, 0.2, 0.15, LocalMapConfig().cell
WALL_ENDS_AT = 0.5


def corridor() -> World:
    """A long wall on the left; on the right one that ends, and a bay behind its end."""
    corners = [(-9, 1), (9, 1), (9, -4), (WALL_ENDS_AT, -4), (WALL_ENDS_AT, -0.9), (-8, -0.9), (-9, 1)]
    return World.empty().with_segments(polyline(corners))


def scan_at(pose: F64, seed: int = 0) -> Scan:
    geometry = sick_lms200()
    ranges = cast(corridor(), compose(pose, geometry.T_robot_laser)[None], geometry.bearings, 20.0)[0]
    noise = np.random.default_rng(seed).normal(0.0, 0.005, len(ranges))
    return Scan(ranges=np.where(np.isfinite(ranges), ranges + noise, np.nan).astype(np.float32), geometry=geometry)


AHEAD, BACK = np.zeros(3), np.array([1.2, -0.3, 2.8])


def surfaces_through(
    points: F64, normals: F64, T_ref_robot: F64, geometry: ScanGeometry, ranges: F64
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], list[list[int]]]:
    """Which surfaces are seen, which are looked through, and the beams that pass each of the latter."""
    T_ref_laser = compose(T_ref_robot, geometry.T_robot_laser)
    p_laser = transform_points(between(T_ref_laser, np.zeros(3)), points)
    p_normal = transform_points(np.array([0.0, 0.0, -T_ref_laser[2]]), normals)
    seen, through = np.zeros(len(points), bool), np.zeros(len(points), bool)
    passing: list[list[int]] = []
    for k, (p, n) in enumerate(zip(p_laser, p_normal, strict=True)):
        passing.append([])
        distance = np.linalg.norm(p)
        facing = -p @ n / distance if n.any() else 1.0
        beam = round((np.arctan2(p[1], p[0]) - geometry.bearings[0]) / geometry.resolution)
        if not (0.3 <= distance <= REACH and facing >= 0.05 and 1 <= beam < len(ranges) - 1):
            continue
        allowed = max(MARGIN, ACROSS / facing)
        three = ranges[beam - 1 : beam + 2]
        seen[k] = (np.abs(three - distance) <= allowed).any()
        through[k] = (three > distance + allowed).all()
        if through[k]:
            half = round(0.5 * CELL * facing / (distance * geometry.resolution))
            near = range(max(0, beam - half), min(len(ranges), beam + half + 1))
            passing[-1] = [q for q in near if ranges[q] > distance + allowed]
    return seen, through, passing


@pytest.mark.parametrize("seed", range(4))
def test_the_kernels_equal_their_slow_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    geometry = ScanGeometry(
        bearings=np.radians(np.arange(-90.0, 91.0)), range_min=0.0, range_max=30.0, T_robot_laser=rng.normal(0, 0.3, 3)
    )
    ranges = rng.choice([1.0, 3.0, 6.0, 25.0, np.nan], 37).repeat(5)[:181].astype(np.float32)
    n = 9000
    angles = rng.uniform(-np.pi, np.pi, n)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1) * (rng.random(n) < 0.9)[:, None]
    points, pose = rng.uniform(-12, 12, (n, 2)), rng.normal(0, 1, 3)
    laser = geometry.T_robot_laser, geometry.bearings[0], geometry.resolution, ranges, REACH, MARGIN, ACROSS
    seen, through, passing = surfaces_through(points, normals, pose, geometry, ranges.astype(np.float64))
    assert min(seen.sum(), through.sum()) > 30

    marked = np.empty(181, np.bool_)
    count = kernels.beams_through(np.hstack([points, normals]), pose, *laser, CELL, marked)
    assert set(np.flatnonzero(marked).tolist()) == {q for beams in passing for q in beams}
    assert count == marked.sum()

    T_ref_cur = rng.normal(0, 2, 3)
    p_cur = transform_points(between(T_ref_cur, np.zeros(3)), points)
    n_cur = transform_points(np.array([0.0, 0.0, -T_ref_cur[2]]), normals)
    verdicts = np.full(n, kernels.UNSEEN, np.int8)
    kernels.judge_points(p_cur, n_cur, 1, T_ref_cur, pose, *laser, verdicts)
    np.testing.assert_array_equal(verdicts == kernels.SEEN, seen)
    np.testing.assert_array_equal(verdicts == kernels.SEEN_THROUGH, through)


def test_what_one_scan_of_the_reference_saw_another_cannot_deny() -> None:
    geometry = ScanGeometry(bearings=np.radians(np.arange(-90.0, 91.0)), range_min=0.0, range_max=20.0)
    point, facing = np.array([[3.0, 0.0]]), np.array([[-1.0, 0.0]])
    short, long = np.full(181, 3.0, np.float32), np.full(181, 9.0, np.float32)
    for order in ((short, long), (long, short)):
        verdicts = np.zeros(1, np.int8)
        for ranges in order:
            laser = geometry.T_robot_laser, geometry.bearings[0], geometry.resolution, ranges, REACH, MARGIN, ACROSS
            kernels.judge_points(point, facing, 1, np.zeros(3), np.zeros(3), *laser, verdicts)
        assert verdicts[0] == kernels.SEEN


def test_several_scans_are_compared_as_each_is() -> None:
    matcher, poses = IceMatcher(), np.array([AHEAD, BACK, [0.3, 0.1, 0.4], [30.0, 0.0, 0.0]])
    scans = [scan_at(pose, seed) for seed, pose in enumerate(poses)]
    reference = matcher.prepare([scan_at(AHEAD, seed=9)], np.zeros((1, 3)))
    placed = compose(poses, np.array([0.05, -0.1, 0.02]))
    together = matcher.agreement_of_all(reference, scans, placed)
    on_points = [
        evaluate_points(extract_points(s), reference, T, matcher.config.refinement)
        for s, T in zip(scans, placed, strict=True)
    ]
    views = [view(scan, reference, T, matcher.config.refinement) for scan, T in zip(scans, placed, strict=True)]
    assert together.points == sum(len(extract_points(scan)) for scan in scans)
    assert together.known == sum(refined.used for refined in on_points) > 100
    assert 0 < together.inliers == sum(refined.inliers for refined in on_points) < together.known
    assert (together.seen, together.contradicted) == tuple(np.sum(views, axis=0))


def test_all_views_judge_a_point_as_one_after_the_other() -> None:
    rng, points = np.random.default_rng(2), extract_points(scan_at(BACK))
    poses = rng.normal(0.0, 1.0, (5, 3))
    scans = [scan_at(pose, seed) for seed, pose in enumerate(poses)]
    by_all, one_by_one = np.empty(len(points), np.int8), np.full(len(points), kernels.UNSEEN, np.int8)
    limits, T_ref_cur = (REACH, MARGIN, ACROSS), compose(BACK, np.array([0.6, 0.0, 0.0]))
    count = kernels.judge_points_by_all(
        points.points, points.normals, 1, T_ref_cur, sweeps_of(scans, poses), *limits, by_all
    )
    for scan, pose in zip(scans, poses, strict=True):
        g = scan.geometry
        laser = g.T_robot_laser, g.bearings[0], g.resolution, scan.ranges
        kernels.judge_points(points.points, points.normals, 1, T_ref_cur, pose, *laser, *limits, one_by_one)
    np.testing.assert_array_equal(by_all, one_by_one)
    assert 0 < count == np.count_nonzero(by_all == kernels.SEEN_THROUGH)


def test_a_wall_that_slid_past_its_end_is_denied_from_both_sides() -> None:
    matcher, scan = IceMatcher(), scan_at(BACK)
    reference = matcher.prepare([scan_at(AHEAD)], np.zeros((1, 3)))
    points = extract_points(scan)

    def denied(along: float) -> int:
        placed = BACK + np.array([along, 0.0, 0.0])
        return contradictions(scan, points, reference, placed, CELL, matcher.config.refinement)

    assert denied(0.0) == 0
    assert denied(0.4) > 15  # its points lie where the reference looked past the end of the wall
    assert denied(-0.3) > 10  # it looks through the last of the wall


@pytest.mark.parametrize("along", [-0.8, -0.4, 0.0, 0.4, 0.8])
def test_more_overlap_does_not_outweigh_what_is_denied(along: float) -> None:
    T_true = np.array([0.7, -0.3, 2.8])  # the end of the wall lies just outside the field of view
    matcher = IceMatcher()
    reference = matcher.prepare([scan_at(AHEAD, seed=1)], np.zeros((1, 3)))
    guess = T_true + np.array([along, 0.2, 0.3])
    match = matcher.match(reference, scan_at(T_true, seed=2), guess, np.diag([0.5, 0.5, 0.4]) ** 2)
    assert isinstance(match, RelativePose)
    np.testing.assert_allclose(match.T_ref_cur[1:], T_true[1:], atol=0.02)
    assert match.T_ref_cur[0] == pytest.approx(T_true[0], abs=0.2)


def test_shares_of_an_agreement() -> None:
    some = Agreement(points=100, known=50, inliers=40, seen=30, contradicted=10)
    assert (some.overlap, some.fit, some.view) == (0.5, 0.8, 0.75)
    assert some.evidence < some.inliers
    nothing = Agreement()
    assert (nothing.overlap, nothing.fit, nothing.view) == (0.0, 0.0, 1.0)
