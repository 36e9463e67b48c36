"""Marginal covariances of the joint refinement: against poses and lines solved densely; long runs; any map frame."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.factors import Factor
from graph.se2 import adjoint, between, compose
from iceg.slam.joint import covariance as joint_covariance
from iceg.slam.joint.covariance import Walls, joint_information
from iceg.slam.track import UNKNOWN_STEP

Array = NDArray[np.float64]

ODOMETRY = np.diag([0.05, 0.02, 0.02]) ** 2
STEP = np.array([0.3, 0.0, 0.4])
PRECISION = 0.5 / 0.01**2


def _path(k: int) -> Array:
    poses = [np.array([0.3, -0.2, 0.1])]
    for _ in range(k - 1):
        poses.append(compose(poses[-1], STEP))
    return np.array(poses)


def _factors(poses: Array, covariance: Array = ODOMETRY) -> list[Factor]:
    prior = Factor(kind="prior", i=None, j=0, T_i_j=poses[0], covariance=1e-6 * np.eye(3))
    steps = between(poses[:-1], poses[1:])
    chain = [Factor(kind="odometry", i=i, j=i + 1, T_i_j=step, covariance=covariance) for i, step in enumerate(steps)]
    return [prior, *chain]


def _walls(k: int, each: int, seed: int = 0) -> tuple[Walls, NDArray[np.int64]]:
    """Points of every key pose on three walls; the last of them on one that a single pose sees."""
    rng = np.random.default_rng(seed)
    lines = np.array([[4.0, 0.0, -1.0, 0.0], [0.0, 5.0, 0.0, -1.0], [-3.0, -3.0, 0.6, 0.8], [9.0, 9.0, 0.0, 1.0]])
    pieces = np.tile(np.arange(each) % 3, k)
    pieces[-1] = 3
    tangents = np.column_stack([-lines[:, 3], lines[:, 2]])
    placed = lines[pieces, :2] + rng.uniform(-2, 2, (len(pieces), 1)) * tangents[pieces]
    walls = Walls(
        placed=placed,
        errors=np.zeros_like(placed),
        piece_of=pieces,
        lines=lines,
        residuals=0.01 * rng.normal(size=len(pieces)),
        weights=rng.uniform(0.5, 1.0, len(pieces)),
        roughness=0.005,
        on_walls=1.0,
        residual=0.01,
        bends=np.zeros((4, 2)),
    )
    return walls, np.arange(0, each * k + 1, each, dtype=np.int64)


def _dense(poses: Array, starts: NDArray[np.int64], walls: Walls) -> Array:
    """Poses and lines as unknowns of one system, the first pose held."""
    k, m = len(poses), len(walls.lines)
    information = np.zeros((3 * k + 2 * m, 3 * k + 2 * m))
    for i, p in enumerate(walls.placed):
        key, piece = int(np.searchsorted(starts, i, side="right")) - 1, int(walls.piece_of[i])
        x0, y0, nx, ny = walls.lines[piece]
        heading = poses[key, 2]
        row = np.zeros(len(information))
        forward, left = [np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]
        lever = ny * (p[0] - poses[key, 0]) - nx * (p[1] - poses[key, 1])
        row[3 * key : 3 * key + 3] = [np.dot(forward, [nx, ny]), np.dot(left, [nx, ny]), lever]
        row[3 * k + 2 * piece : 3 * k + 2 * piece + 2] = [-1.0, -(nx * (p[1] - y0) - ny * (p[0] - x0))]
        information += PRECISION * walls.weights[i] * np.outer(row, row)
    for key in range(1, k):
        jacobian = np.zeros((3, len(information)))
        jacobian[:, 3 * key - 3 : 3 * key] = -adjoint(between(poses[key], poses[key - 1]))
        jacobian[:, 3 * key : 3 * key + 3] = np.eye(3)
        information += jacobian.T @ np.linalg.inv(ODOMETRY) @ jacobian
    information[3 * k + 6 :, 3 * k + 6 :] += 1e-6 * np.eye(2)  # the line that one point alone leaves undetermined
    inverse = np.linalg.inv(information[3:, 3:])
    return np.array([inverse[3 * a : 3 * a + 3, 3 * a : 3 * a + 3] for a in range(k - 1)])


def test_marginals_are_those_of_poses_and_lines_together() -> None:
    poses = _path(6)
    walls, starts = _walls(6, 9)
    found = joint_information(_factors(poses), poses, starts, walls, PRECISION).covariances
    assert found[1:] == pytest.approx(_dense(poses, starts, walls), rel=1e-4, abs=1e-10)
    assert np.sqrt(found[0].diagonal()).max() < 1e-4


def test_points_of_no_weight_leave_it_to_odometry() -> None:
    poses = _path(5)
    walls, starts = _walls(5, 6)
    without = Walls(
        placed=walls.placed,
        errors=walls.errors,
        piece_of=walls.piece_of,
        lines=walls.lines,
        residuals=walls.residuals,
        weights=np.zeros(len(walls.placed)),
        roughness=0.005,
        on_walls=0.0,
        residual=0.01,
        bends=np.zeros((4, 2)),
    )
    found = joint_information(_factors(poses), poses, starts, without, PRECISION).covariances
    assert found[1] == pytest.approx(ODOMETRY, rel=1e-3, abs=1e-8)
    grown = np.linalg.eigvalsh(found).sum(axis=1)
    assert (np.diff(grown) > 0.0).all()


def test_matches_count_only_where_there_is_no_odometry() -> None:
    poses = _path(4)
    walls, starts = _walls(4, 6)
    walls.weights[:] = 0.0
    factors = _factors(poses)
    tight = 1e-2 * ODOMETRY
    match = [Factor(kind="ice", i=i, j=i + 1, T_i_j=STEP, covariance=tight) for i in range(3)]
    beside = joint_information([*factors, *match], poses, starts, walls, PRECISION).covariances
    alone = joint_information([factors[0], *match], poses, starts, walls, PRECISION).covariances
    assert beside == pytest.approx(joint_information(factors, poses, starts, walls, PRECISION).covariances)
    assert alone[3, 0, 0] < 0.1 * beside[3, 0, 0]


def test_long_runs_have_anchors(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = _path(60)
    walls, starts = _walls(60, 12)
    match = [Factor(kind="ice", i=i, j=i + 1, T_i_j=STEP, covariance=1e-5 * np.eye(3)) for i in range(59)]
    factors = [*_factors(poses), *match]
    exact = joint_information(factors, poses, starts, walls, PRECISION).covariances
    monkeypatch.setattr(joint_covariance, "_ALL_ALONE", 22)
    monkeypatch.setattr(joint_covariance, "_MOST_ANCHORS", 22)
    coarse = joint_information(factors, poses, starts, walls, PRECISION).covariances
    ratio = np.trace(coarse[1:], axis1=1, axis2=2) / np.trace(exact[1:], axis1=1, axis2=2)
    assert 0.8 < ratio.min() < ratio.max() < 1.25
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)  # with the first four as one group it is 0.76
    assert (np.linalg.eigvalsh(coarse) > 0.0).all()


@pytest.mark.parametrize("key", [30, 31])
def test_no_group_reaches_across_a_step_that_nothing_has_seen(monkeypatch: pytest.MonkeyPatch, key: int) -> None:
    poses = _path(60)
    walls, starts = _walls(60, 12)
    walls.weights[starts[key] :] = 0.0
    factors = [replace(f, covariance=UNKNOWN_STEP) if f.j == key else f for f in _factors(poses)]
    monkeypatch.setattr(joint_covariance, "_ALL_ALONE", 59)
    deviations = np.sqrt(joint_information(factors, poses, starts, walls, PRECISION).covariances[:, 0, 0])
    assert deviations[:key].max() < 1.0
    assert deviations[key:].min() > 50.0


def test_runs_of_middling_length_have_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = _path(60)
    walls, starts = _walls(60, 12)
    exact = joint_information(_factors(poses), poses, starts, walls, PRECISION).covariances
    monkeypatch.setattr(joint_covariance, "_ALL_ALONE", 59)
    pairs = joint_information(_factors(poses), poses, starts, walls, PRECISION).covariances
    deviations = np.sqrt(np.diagonal(pairs[1:], axis1=1, axis2=2) / np.diagonal(exact[1:], axis1=1, axis2=2))
    assert np.median(deviations) == pytest.approx(1.0, abs=0.1)
    assert (deviations != 1.0).any()
    assert (deviations > 0.8).all()


def test_groups_leave_the_odometry_of_a_path_that_sees_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = _path(41)
    walls, starts = _walls(41, 6)
    walls.weights[:] = 0.0
    exact = joint_information(_factors(poses), poses, starts, walls, PRECISION).covariances
    monkeypatch.setattr(joint_covariance, "_ALL_ALONE", 15)
    monkeypatch.setattr(joint_covariance, "_MOST_ANCHORS", 15)
    coarse = joint_information(_factors(poses), poses, starts, walls, PRECISION).covariances
    anchors = [*range(8), *range(8, 41, 5)]
    np.testing.assert_allclose(coarse[:8], exact[:8], rtol=1e-6, atol=1e-12)
    assert np.linalg.eigvalsh(coarse[anchors] - 0.999 * exact[anchors]).min() > -1e-9


def test_marginals_do_not_depend_on_where_the_map_lies() -> None:
    poses = _path(4)
    walls, starts = _walls(4, 30)
    covariances = joint_information(_factors(poses), poses, starts, walls, PRECISION).covariances
    assert (np.linalg.eigvalsh(covariances) > 0.0).all()
    turned = compose(np.array([3.0, -1.0, 2.0]), poses)
    c, s = np.cos(2.0), np.sin(2.0)
    rotation = np.array([[c, -s], [s, c]])
    moved = Walls(
        placed=walls.placed @ rotation.T + [3.0, -1.0],
        errors=walls.errors @ rotation.T,
        piece_of=walls.piece_of,
        lines=np.column_stack([walls.lines[:, :2] @ rotation.T + [3.0, -1.0], walls.lines[:, 2:] @ rotation.T]),
        residuals=walls.residuals,
        weights=walls.weights,
        roughness=0.005,
        on_walls=1.0,
        residual=0.01,
        bends=np.zeros((4, 2)),
    )
    assert joint_information(_factors(turned), turned, starts, moved, PRECISION).covariances == pytest.approx(
        covariances, rel=1e-5, abs=1e-12
    )
