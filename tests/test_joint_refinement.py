"""Joint refinement of poses and map: its kernels against dense twins, and what it does to a simulated office."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.simulator.simulation import Simulation, simulate
from graph.batch import marginal_covariances, optimize
from graph.config import PoseGraphConfig
from graph.factors import Factor
from graph.odometry import OdometryModel
from graph.problem import Problem
from graph.se2 import between, compose, expmap, inverse, transform_points
from iceg.evaluation.trajectory import trajectory_errors
from iceg.ice.matcher import IceMatcher
from iceg.pipeline import run
from iceg.slam.back_end import solve_track
from iceg.slam.checked_settings import SlamConfigError
from iceg.slam.config import FinishConfig, FrontEndConfig, LoopClosureConfig
from iceg.slam.finish import Finished, matched_again, refined
from iceg.slam.joint import _wall_kernels as kernels
from iceg.slam.joint._system_kernels import JointSystem, PointsOnLines, fill, normal_equations, product
from iceg.slam.joint.refinement import Clouds, key_clouds, refine_jointly
from iceg.slam.joint_config import JointRefinementConfig
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.odometry.motions import motions_of
from iceg.slam.solution import Solution
from iceg.slam.track import Track
from iceg.slam.tracking.log_tracking import track_log

Array = NDArray[np.float64]

ROUGHNESS = JointRefinementConfig().roughness
ROOM = np.array([[-4.0, -3.0], [5.0, -3.0], [5.0, 3.0], [-4.0, 3.0]])
"""Corners, counter-clockwise."""


def room_points(pose: Array, n: int, noise: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Points on the walls of the room and their normals inwards, in the frame of a pose."""
    side = rng.integers(0, 4, n)
    along = rng.uniform(0.0, 1.0, n)[:, None]
    starts, ends = ROOM[side], ROOM[(side + 1) % 4]
    tangents = (ends - starts) / np.linalg.norm(ends - starts, axis=1)[:, None]
    inwards = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    points = starts + along * (ends - starts) + noise * rng.normal(size=(n, 1)) * inwards
    c, s = np.cos(pose[2]), np.sin(pose[2])
    to_robot = np.array([[c, s], [-s, c]])
    return (points - pose[:2]) @ to_robot.T, inwards @ to_robot.T


def room_clouds(poses: Array, n: int = 60, noise: float = 0.01, seed: int = 0) -> Clouds:
    rng = np.random.default_rng(seed)
    scans = [room_points(pose, n, noise, rng) for pose in poses]
    return Clouds(
        points=np.concatenate([points for points, _ in scans]),
        normals=np.concatenate([normals for _, normals in scans]),
        errors=np.zeros((n * len(poses), 2)),
        spreads=np.ones(n * len(poses)),
        starts=n * np.arange(len(poses) + 1),
        key_of_scan=np.arange(len(poses)),
        T_key_scan=np.zeros((len(poses), 3)),
    )


def corridor_clouds(poses: Array, seed: int, n: int = 200, noise: float = 0.01) -> Clouds:
    """Points on two bare walls along x, on either side of poses that face along them."""
    rng = np.random.default_rng(seed)
    side = rng.choice([-1.0, 1.0], n * len(poses))
    ahead, across = rng.uniform(-4.0, 4.0, len(side)), 1.5 * side + noise * rng.normal(size=len(side))
    return Clouds(
        points=np.column_stack([ahead, across]),
        normals=np.column_stack([np.zeros(len(side)), -side]),
        errors=np.zeros((len(side), 2)),
        spreads=np.ones(len(side)),
        starts=n * np.arange(len(poses) + 1),
        key_of_scan=np.arange(len(poses)),
        T_key_scan=np.zeros((len(poses), 3)),
    )


def camera_clouds(poses: Array, seed: int, noise: float = 0.015) -> Clouds:
    """What a camera that looks along a corridor 2 m wide sees of its walls; ranges err by so much a metre."""
    bearings = np.radians(np.linspace(8.0, 28.0, 50))
    beams = np.column_stack([np.cos(bearings), np.sin(bearings)])
    beams = np.concatenate([beams, beams * [1.0, -1.0]])
    ranges = 1.0 / np.abs(beams[:, 1])
    errors = noise * np.random.default_rng(seed).normal(size=(len(poses), len(ranges)))
    return Clouds(
        points=((1.0 + errors) * ranges).reshape(-1, 1) * np.tile(beams, (len(poses), 1)),
        normals=np.tile(np.column_stack([np.zeros(len(beams)), -np.sign(beams[:, 1])]), (len(poses), 1)),
        errors=np.tile(noise * ranges[:, None] * beams, (len(poses), 1)),
        spreads=np.ones(len(poses) * len(beams)),
        starts=len(beams) * np.arange(len(poses) + 1),
        key_of_scan=np.arange(len(poses)),
        T_key_scan=np.zeros((len(poses), 3)),
    )


def chain(poses: Array, deviations: tuple[float, float, float], seed: int = 0) -> list[Factor]:
    """A prior and noisy odometry."""
    rng, covariance = np.random.default_rng(seed), np.diag(deviations) ** 2
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=poses[0], covariance=1e-8 * np.eye(3))]
    for j in range(1, len(poses)):
        T_i_j = compose(between(poses[j - 1], poses[j]), expmap(np.array(deviations) * rng.normal(size=3)))
        factors.append(Factor(kind="odometry", i=j - 1, j=j, T_i_j=T_i_j, covariance=covariance))
    return factors


def drive(n: int = 12) -> Array:
    rng = np.random.default_rng(5)
    return np.column_stack([np.linspace(-2.0, 3.0, n), rng.uniform(-1.0, 1.0, n), rng.uniform(-3.0, 3.0, n)])


def placed_in_map(clouds: Clouds, poses: Array) -> kernels.Points:
    n = len(clouds.points)
    placed = kernels.Points(np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 2)))
    kernels.place(poses, clouds.starts, kernels.Points(clouds.points, clouds.normals, clouds.errors), placed)
    return placed


def grouped(placed: Array, turned: Array, config: JointRefinementConfig) -> NDArray[np.int64]:
    member = np.empty(len(placed), np.int64)
    surfels, keys, surfel_at = kernels.surfels(placed, turned, config.cell, config.cell_facing, member)
    piece = np.empty(len(surfels), np.int64)
    order = np.argsort(-surfels[:, 4], kind="stable")
    kernels.group(
        surfels,
        order,
        config.cell,
        config.half_length,
        config.half_width,
        config.facing,
        keys,
        surfel_at,
        piece,
    )
    return np.where(member >= 0, piece[member], -1)


def grouped_slowly(placed: Array, turned: Array, config: JointRefinementConfig) -> list[int]:
    """The same with lists and dictionaries."""
    corner = placed.min(axis=0) - 100.0
    surfels: list[list[int]] = []
    in_cell: dict[tuple[int, int], list[int]] = {}
    for i, (point, normal) in enumerate(zip(placed, turned, strict=True)):
        if not normal.any():
            continue
        u, v = np.floor((point - corner) / config.cell).astype(int).tolist()
        here = in_cell.setdefault((u, v), [])
        for k in here:
            if turned[surfels[k]].sum(axis=0) @ normal >= config.cell_facing * len(surfels[k]):
                surfels[k].append(i)
                break
        else:
            here.append(len(surfels))
            surfels.append([i])
    means = np.array([placed[some].mean(axis=0) for some in surfels])
    normals = np.array([turned[some].sum(axis=0) for some in surfels])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    piece_of = [-1] * len(placed)
    taken = np.zeros(len(surfels), bool)
    pieces = 0
    for first in sorted(range(len(surfels)), key=lambda k: -len(surfels[k])):
        if taken[first]:
            continue
        apart = means - means[first]
        across = np.abs(apart @ normals[first])
        along = np.abs(apart @ np.array([-normals[first, 1], normals[first, 0]]))
        near = (across < config.half_width) & (along < config.half_length) & (normals @ normals[first] >= config.facing)
        near[first] = True
        for member in np.flatnonzero(near & ~taken):
            for i in surfels[member]:
                piece_of[i] = pieces
        taken |= near
        pieces += 1
    return piece_of


def test_pieces_of_wall() -> None:
    poses, config = drive(), JointRefinementConfig()
    clouds = room_clouds(poses, noise=0.03)
    clouds.normals[::7] = 0.0
    placed, turned, _ = placed_in_map(clouds, poses)
    np.testing.assert_allclose(placed[60:120], transform_points(poses[1], clouds.points[60:120]), atol=1e-12)
    found = grouped(placed, turned, config)
    assert found.tolist() == grouped_slowly(placed, turned, config)
    assert (found[::7] == -1).all()
    # No piece goes round a corner.
    for piece in range(found.max() + 1):
        facing = turned[found == piece]
        assert (facing @ facing[0] > 0.5).all()


@pytest.mark.parametrize(("apart", "together"), [(0.1, True), (0.3, False)])
def test_two_passes_over_one_wall(apart: float, together: bool) -> None:
    x = np.arange(0.005, 0.2, 0.01)
    placed = np.vstack([np.column_stack([x, np.zeros_like(x)]), np.column_stack([x, np.full_like(x, apart)])])
    turned = np.tile([0.0, 1.0], (len(placed), 1))
    piece = grouped(placed, turned, JointRefinementConfig())
    assert bool(piece[0] == piece[-1]) is together
    # The two faces of a thin wall are never one.
    turned[len(x) :] = [0.0, -1.0]
    piece = grouped(placed, turned, JointRefinementConfig())
    assert piece[0] != piece[-1]


def system_of(clouds: Clouds, poses: Array) -> tuple[Array, Array, NDArray[np.int64], Array, Array, Array]:
    """H and gradient of the kernel as one dense matrix, and what they were made from."""
    placed = placed_in_map(clouds, poses)
    piece_of = grouped(placed.points, placed.normals, JointRefinementConfig())
    n, m, k = len(placed.points), int(piece_of.max()) + 1, len(poses)
    lines, residuals, weights = np.empty((m, 4)), np.empty(n), np.empty(n)
    fit = kernels.LineFit(scale=0.04, rounds=3, elongation=4.0, facing=0.9)
    kernels.fit_lines(placed, np.ones(n), piece_of, fit, lines, residuals, weights)
    seen = PointsOnLines(
        clouds.key_starts,
        placed.points,
        placed.errors,
        piece_of,
        lines,
        residuals,
        weights,
        ROUGHNESS,
        np.zeros((m, 2)),
    )
    system = normal_equations(poses, seen)
    columns = [product(system, m, e.reshape(k, 3)).ravel() for e in np.eye(3 * k)]
    filled = np.zeros((3 * k, 3 * k))
    order = np.argsort(system.line_of, kind="stable")
    blocks = (system.pose_of[order], system.line_of[order], system.blocks[order])
    fill(JointSystem(system.diagonal, system.gradient, *blocks), filled)
    np.testing.assert_allclose(filled, np.column_stack(columns), atol=1e-9 * np.abs(filled).max())
    return np.column_stack(columns), system.gradient.ravel(), piece_of, lines, residuals, weights


def feet_of(clouds: Clouds, poses: Array, normals: Array, residuals: Array) -> Array:
    """Where the points most probably were along their beams, in the map, if surfaces are as even as said."""
    placed = placed_in_map(clouds, poses)
    across = np.vecdot(normals, placed.errors)
    share = residuals * across / (across**2 + ROUGHNESS**2)
    return np.asarray(placed.points - share[:, None] * placed.errors)


@pytest.mark.parametrize("errs", [False, True])
def test_normal_equations_are_those_of_poses_and_lines_without_the_lines(errs: bool) -> None:
    poses = drive(4)
    clouds = room_clouds(poses, n=40, noise=0.02)
    if errs:
        clouds.errors[:] = 0.02 * clouds.points
    hessian, gradient, piece_of, lines, residuals, weights = system_of(clouds, poses)
    k, m = len(poses), len(lines)
    feet = feet_of(clouds, poses, lines[piece_of, 2:], residuals)
    on_robots = [transform_points(inverse(T), p) for T, p in zip(poses, feet.reshape(k, -1, 2), strict=True)]

    def distances(x: Array) -> Array:
        """Of the feet of all points from their lines after a step of the poses and of the lines (offset, turn)."""
        moved = compose(poses, expmap(x[: 3 * k].reshape(k, 3)))
        offsets, turns = x[3 * k :].reshape(m, 2).T
        at = np.vstack([transform_points(T, p) for T, p in zip(moved, on_robots, strict=True)])
        c, s = np.cos(turns), np.sin(turns)
        nx, ny = c * lines[:, 2] - s * lines[:, 3], s * lines[:, 2] + c * lines[:, 3]
        apart = at - lines[piece_of, :2]
        return np.asarray(nx[piece_of] * apart[:, 0] + ny[piece_of] * apart[:, 1] + offsets[piece_of])

    if not errs:  # else the feet lie nearer to the lines than the points do
        np.testing.assert_allclose(distances(np.zeros(3 * k + 2 * m)), residuals, atol=1e-12)
    h = 1e-6
    jacobian = np.column_stack([(distances(h * e) - distances(-h * e)) / (2 * h) for e in np.eye(3 * k + 2 * m)])
    full = jacobian.T @ (weights[:, None] * jacobian)
    full[3 * k :, 3 * k :] += np.diag(np.tile([1e-3, 1e-3 * 0.05**2], m))
    slope = jacobian.T @ (weights * residuals)
    lines_out = full[: 3 * k, 3 * k :] @ np.linalg.inv(full[3 * k :, 3 * k :])
    np.testing.assert_allclose(hessian, full[: 3 * k, : 3 * k] - lines_out @ full[3 * k :, : 3 * k], atol=1e-4)
    np.testing.assert_allclose(gradient, slope[: 3 * k] - lines_out @ slope[3 * k :], atol=1e-4)


def test_lines_are_fitted_and_outliers_are_not_on_them() -> None:
    rng = np.random.default_rng(1)
    x = rng.uniform(-0.25, 0.25, 50)
    placed = np.column_stack([x, 0.3 * x + 0.004 * rng.normal(size=50)])
    placed[:3, 1] += 0.12
    turned = np.tile([0.0, 1.0], (50, 1))
    lines, residuals, weights = np.empty((1, 4)), np.empty(50), np.empty(50)
    fit = kernels.LineFit(scale=0.02, rounds=3, elongation=4.0, facing=0.9)
    seen = kernels.Points(placed, turned, np.zeros((50, 2)))
    total, squares = kernels.fit_lines(seen, np.ones(50), np.zeros(50, np.int64), fit, lines, residuals, weights)
    normal = np.array([-0.3, 1.0]) / np.hypot(0.3, 1.0)
    assert lines[0, 2:] @ normal > np.cos(0.02)
    assert lines[0, 3] > 0.0
    assert weights[:3].max() < 0.1
    assert weights[3:].min() > 0.5
    assert (total, squares) == pytest.approx((weights.sum(), weights @ residuals**2))


def test_errors_along_the_beams_do_not_turn_a_wall_towards_them() -> None:
    rng = np.random.default_rng(2)
    on_wall = np.column_stack([rng.uniform(-0.25, 0.25, 20_000), np.zeros(20_000)])
    beams = on_wall - [-4.0, 1.0]
    beams /= np.linalg.norm(beams, axis=1)[:, None]
    errors, turned = 0.05 * beams, np.tile([0.0, 1.0], (len(beams), 1))
    placed = on_wall + rng.normal(size=(len(beams), 1)) * errors
    fit = kernels.LineFit(scale=1.0, rounds=3, elongation=4.0, facing=0.9)
    lines, residuals, weights = np.empty((1, 4)), np.empty(len(beams)), np.empty(len(beams))
    tilts = []
    for known in (errors, np.zeros_like(errors)):
        seen = kernels.Points(placed, turned, known)
        kernels.fit_lines(seen, np.ones(len(beams)), np.zeros(len(beams), np.int64), fit, lines, residuals, weights)
        tilts.append(float(lines[0, 2]))
    # Cov(along, across) = σ² cos sin over the variance of the points along the wall.
    assert tilts[1] == pytest.approx(-(0.05**2) * (4.0 / 17.0) / (0.5**2 / 12.0 + 0.05**2), rel=0.1) or tilts[1] > 0.02
    assert abs(tilts[0]) < 0.1 * abs(tilts[1])


def test_a_camera_along_a_corridor_goes_as_far_as_it_went() -> None:
    truth = np.column_stack([0.25 * np.arange(40), np.zeros((40, 2))])
    factors = [
        replace(factor, T_i_j=truth[0] if factor.i is None else between(truth[factor.i], truth[factor.j]))
        for factor in chain(truth, (0.05, 0.02, 0.01))
    ]
    off: list[list[float]] = []
    for seed in range(8):
        clouds = camera_clouds(truth, seed)
        unknown = replace(clouds, errors=np.zeros_like(clouds.errors))
        ends = [refine_jointly(factors, truth, some, JointRefinementConfig()).poses[-1] for some in (clouds, unknown)]
        off.append([float(end[0] - truth[-1, 0]) for end in ends])
    known, without = np.sqrt(np.mean(np.square(off), axis=0))
    assert known < 0.06
    assert known < 0.6 * without


def test_the_linearization_of_a_graph() -> None:
    poses = drive(6)
    factors = chain(poses, (0.1, 0.05, 0.02))
    factors.append(replace(factors[2], i=0, j=4, kind="closure"))
    problem = Problem.of(factors, len(poses))
    linearized = problem.linearized(poses)
    rng, h = np.random.default_rng(2), 1e-6
    direction = rng.normal(size=(6, 3))
    losses = [problem.evaluate(compose(poses, expmap(sign * h * direction))).losses.sum() for sign in (1, -1)]
    assert float(np.vdot(linearized.gradient, direction)) == pytest.approx((losses[0] - losses[1]) / (2 * h), rel=1e-4)
    np.testing.assert_allclose(linearized.times(linearized.solve(direction)), direction, atol=1e-9)


def worst(poses: Array, truth: Array) -> float:
    error = between(truth, compose(compose(truth[0], [0.0, 0.0, 0.0]), between(poses[0], poses)))
    return float(np.hypot(error[:, 0], error[:, 1]).max())


def test_a_room_seen_from_everywhere_straightens_the_path() -> None:
    truth = drive()
    factors = chain(truth, (0.03, 0.03, 0.01))
    start = optimize(factors, truth).poses
    assert worst(start, truth) > 0.08
    refined = refine_jointly(factors, start, room_clouds(truth), JointRefinementConfig(steps=15, tolerance=1e-4))
    assert worst(refined.poses, truth) < 0.02
    assert refined.residual < refined.residual_before
    assert refined.error > refined.error_before  # odometry alone was at its optimum
    np.testing.assert_allclose(refined.poses[0], start[0], atol=1e-9)


def test_few_steps_bring_most_of_what_many_do() -> None:
    truth = drive()
    factors = chain(truth, (0.02, 0.02, 0.006))
    start = optimize(factors, truth).poses
    few = refine_jointly(factors, start, room_clouds(truth), JointRefinementConfig())
    many = refine_jointly(factors, start, room_clouds(truth), JointRefinementConfig(steps=15, tolerance=1e-4))
    assert worst(few.poses, many.poses) < 0.2 * worst(start, many.poses)


def exact_chain(poses: Array) -> list[Factor]:
    """A prior and odometry that is right."""
    return [
        replace(factor, T_i_j=poses[0] if factor.i is None else between(poses[factor.i], poses[factor.j]))
        for factor in chain(poses, (0.03, 0.03, 0.01))
    ]


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_in_a_room_the_walls_are_believed(noise: float) -> None:
    truth = drive()
    result = refine_jointly(exact_chain(truth), truth, room_clouds(truth, noise=noise), JointRefinementConfig())
    assert result.share > 0.8
    assert result.information is not None
    assert result.covariances is not None


def test_what_walls_along_a_corridor_say_of_the_way_along_it_is_hardly_believed() -> None:
    truth = np.column_stack([np.linspace(0.0, 4.0, 12), np.zeros((12, 2))])
    ratios = []
    for seed in range(6):
        factors = chain(truth, (0.3, 0.001, 0.0002), seed)
        start = optimize(factors, truth).poses
        result = refine_jointly(factors, start, corridor_clouds(truth, seed), JointRefinementConfig())
        graph = Problem.of(factors, len(truth)).marginal_covariances(start)
        believed = graph if result.covariances is None else result.covariances
        ratios.append(believed[-1, 0, 0] / graph[-1, 0, 0])
    # Noise tilts the pieces of both walls, so that they seem to hold the poses: they alone claim 0.01 to 0.03.
    assert np.mean(ratios) > 0.4
    assert min(ratios) > 0.1


def test_parts_that_nothing_ties_share_no_walls() -> None:
    truth = drive()
    factors = chain(truth, (0.03, 0.03, 0.01))
    factors = [f if f.j != 6 else replace(f, covariance=np.diag([0.1, 0.1, 0.05]) ** 2) for f in factors]
    start = optimize(factors, truth).poses
    config = JointRefinementConfig(steps=8, tolerance=1e-4)
    tied, apart = (refine_jointly(factors, start, room_clouds(truth), config, parts) for parts in ((), (6,)))
    step, tied_step, apart_step = (between(poses[5], poses[6]) for poses in (start, tied.poses, apart.poses))
    assert np.hypot(*(tied_step - step)[:2]) > 0.02
    np.testing.assert_allclose(apart_step, step, atol=5e-3)
    assert len(apart.walls) > len(tied.walls)


def test_points_without_walls_change_nothing() -> None:
    truth = drive()
    factors = chain(truth, (0.03, 0.03, 0.01))
    clouds = room_clouds(truth)
    clouds.normals[:] = 0.0
    nothing = Clouds(
        points=np.empty((0, 2)),
        normals=np.empty((0, 2)),
        errors=np.empty((0, 2)),
        spreads=np.empty(0),
        starts=np.zeros(len(truth) + 1, np.int64),
        key_of_scan=np.arange(len(truth)),
        T_key_scan=np.zeros((len(truth), 3)),
    )
    for points in (clouds, nothing):
        refined = refine_jointly(factors, truth, points, JointRefinementConfig())
        assert len(refined.walls) == 0
        np.testing.assert_array_equal(refined.poses, truth)


@pytest.fixture(scope="module")
def office() -> Simulation:
    whole = simulate("office", seed=3)
    log = whole.log
    n = 1100
    return replace(
        whole,
        log=replace(log, ranges=log.ranges[:n], odometry=log.odometry[:n], stamps=log.stamps[:n]),
        truth=whole.truth[:n],
    )


@pytest.fixture(scope="module")
def matcher() -> IceMatcher:
    return IceMatcher()


@pytest.fixture(scope="module")
def track(office: Simulation, matcher: IceMatcher) -> Track:
    return track_log(office.log, matcher, OdometryModel(), FrontEndConfig())


@pytest.fixture(scope="module")
def solution(office: Simulation, matcher: IceMatcher, track: Track) -> Solution:
    return solve_track(
        LoopCloser(matcher, track, LoopClosureConfig()),
        motions_of(track, office.log.odometry, OdometryModel()),
        PoseGraphConfig(),
    )


def test_points_of_key_scans_and_of_scans_between(office: Simulation, track: Track) -> None:
    alone = key_clouds(track, office.log.scan, JointRefinementConfig(scans_per_key=1))
    assert alone.key_of_scan.tolist() == list(range(len(track.keys)))
    whole = key_clouds(track, office.log.scan, JointRefinementConfig(scans_per_key=100))
    assert len(whole.key_of_scan) == len(office.log)
    scans = np.concatenate([np.flatnonzero(track.key_of_scan == key) for key in range(len(track.keys))])
    np.testing.assert_allclose(whole.T_key_scan, track.T_key_scan[scans], atol=1e-12)
    third = key_clouds(track, office.log.scan, JointRefinementConfig(max_points=len(whole.points) // 3))
    assert len(third.points) <= len(whole.points) // 3
    assert third.key_starts[-1] == len(third.points)
    assert (np.diff(third.key_starts) > 0).all()
    assert (alone.stand_for, whole.stand_for) == (1.0, 1.0)
    assert third.stand_for == pytest.approx(3.0, rel=0.4)


def test_points_that_stand_for_many_tell_more(solution: Solution, track: Track, office: Simulation) -> None:
    config = JointRefinementConfig(max_points=20_000, scans_per_key=1)
    clouds, factors = key_clouds(track, office.log.scan, config), solution.factors
    few, some, many = (
        refine_jointly(factors, solution.poses, replace(clouds, stand_for=n), config) for n in (1.0, 4.0, 32.0)
    )
    assert few.covariances is not None
    assert some.covariances is not None
    assert many.covariances is not None
    np.testing.assert_array_equal(many.poses, few.poses)
    np.testing.assert_array_equal(some.covariances, few.covariances)
    ratio = np.linalg.det(many.covariances[1:]) / np.linalg.det(few.covariances[1:])
    assert 0.25**3 < np.median(ratio) < 0.5**3


def test_points_whose_variances_are_larger_tell_less(solution: Solution, track: Track, office: Simulation) -> None:
    config = JointRefinementConfig(max_points=20_000, scans_per_key=1)
    clouds, factors = key_clouds(track, office.log.scan, config), solution.factors
    usual, doubted = (
        refine_jointly(factors, solution.poses, replace(clouds, variance_scale=scale), config).information
        for scale in (1.0, 4.0)
    )
    assert usual is not None
    assert doubted is not None
    # Beside the points there are only odometry and the first pose, which is held: some of four is left.
    ratio = np.linalg.det(doubted.covariances[1:]) / np.linalg.det(usual.covariances[1:])
    assert 2.0**3 < np.median(ratio) <= 4.0**3


def finished_with(solution: Solution, track: Track, office: Simulation, matcher: IceMatcher, joint: bool) -> Finished:
    config = FinishConfig(joint=JointRefinementConfig(enabled=joint))
    found, rounds = matched_again(solution, track, matcher, LoopClosureConfig(), config)
    return refined(found, rounds, track, matcher, config, scan_of=office.log.scan)


def test_the_finish_of_an_office(solution: Solution, track: Track, office: Simulation, matcher: IceMatcher) -> None:
    truth = office.truth[[key.index for key in track.keys]]
    without = finished_with(solution, track, office, matcher, joint=False)
    finished = finished_with(solution, track, office, matcher, joint=True)
    assert [done.stage for done in without.rounds] == ["solve", "rematch"]
    assert [done.stage for done in finished.rounds] == ["solve", "rematch", "joint"]

    def error(poses: Array) -> float:
        return trajectory_errors(poses, truth).ate_rmse

    assert error(finished.solution.poses) < 0.9 * error(without.solution.poses)
    last = finished.rounds[-1]
    assert last.residual_before is not None
    assert last.residual is not None
    assert last.residual < last.residual_before
    assert 0.0 < last.mean_move <= last.largest_move < 0.2
    # The factors stay as they were measured: their own optimum is where the poses were before.
    again = optimize(finished.solution.factors, finished.solution.poses)
    np.testing.assert_allclose(again.poses, without.solution.poses, atol=2e-3)
    assert again.error_after == pytest.approx(without.rounds[-1].error, rel=0.01)


def test_a_run_says_where_its_covariances_come_from(office: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    log = office.log.select(slice(300))
    usual = run(log)
    assert usual.summary["finish"][-1]["covariances_from"] == "walls"
    assert not any("covariances" in warning for warning in usual.summary["warnings"])

    def singular(*_: object) -> Array:
        raise np.linalg.LinAlgError

    monkeypatch.setattr("iceg.slam.joint.refinement.joint_information", singular)
    without = run(log)
    assert without.summary["finish"][-1]["covariances_from"] == "graph"
    assert any("the walls of the map do not confirm" in w for w in without.summary["warnings"])
    np.testing.assert_array_equal(without.key_poses, usual.key_poses)
    np.testing.assert_array_equal(without.covariances, marginal_covariances(without.graph.factors, without.key_poses))


def test_settings_out_of_range() -> None:
    with pytest.raises(SlamConfigError, match="half_length"):
        JointRefinementConfig(half_length=0.0)
    with pytest.raises(SlamConfigError, match="max_points 0, expected a number from 1"):
        JointRefinementConfig(max_points=0)
