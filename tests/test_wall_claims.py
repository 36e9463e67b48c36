"""Poses between the graph's optimum and the walls' are as uncertain as the way they went says; what the graph knows
better it is believed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from iceg.slam.joint.wall_claims import believed_covariances, claims_warning, variance_factor
from iceg.slam.joint_config import JointRefinementConfig

Array = NDArray[np.float64]
CONFIG = JointRefinementConfig()


def _covariances(n: int, scale: float, seed: int = 0) -> Array:
    """Random ones of one size; none for the first pose, which the others are relative to."""
    roots = np.random.default_rng(seed).normal(size=(n, 3, 3))
    found = np.asarray(scale**2 * (roots @ np.swapaxes(roots, 1, 2) + 0.3 * np.eye(3)), dtype=np.float64)
    found[0] = 1e-10 * np.eye(3)
    return found


def test_the_walls_are_believed_where_the_poses_went_all_of_the_way() -> None:
    graph = _covariances(20, 0.1)
    walls = graph / 2.5**2
    np.testing.assert_allclose(believed_covariances(walls, graph, 1.0), walls, rtol=1e-12)


def test_the_graph_is_believed_where_the_poses_did_not_go() -> None:
    graph = _covariances(20, 0.1)
    believed = believed_covariances(_covariances(20, 0.05, seed=1), graph, 0.0)
    np.testing.assert_allclose(believed[1:], graph[1:], rtol=1e-9)


def test_part_of_the_way_and_a_direction_that_the_graph_knows_better() -> None:
    graph = _covariances(9, 0.1)
    root = np.asarray(np.linalg.cholesky(graph), dtype=np.float64)
    walls = root @ np.diag([0.5, 0.04, 4.0]) @ np.swapaxes(root, 1, 2)
    walls[0] = graph[0]
    believed = believed_covariances(walls, graph, 0.75)
    # 3/4 of the walls' variance, that of the graph where it is the smaller one, and 1/4 of the graph's.
    expected = root[1:] @ np.diag([0.625, 0.28, 1.0]) @ np.swapaxes(root[1:], 1, 2)
    np.testing.assert_allclose(believed[1:], expected, rtol=1e-9, atol=1e-14)
    np.testing.assert_array_equal(believed[0], walls[0])


@given(share=st.floats(0.0, 1.0), correlation=st.floats(-1.0, 1.0), ratio=st.floats(0.25, 1.0))
def test_it_bounds_the_error_however_those_of_walls_and_graph_hang_together(
    share: float, correlation: float, ratio: float
) -> None:
    graph = np.tile(0.04 * np.eye(3), (2, 1, 1))
    believed = believed_covariances(ratio**2 * graph, graph, share)
    # The error of a pose that went the share a of the way: a times that of the walls and 1 - a times that of the graph.
    of_walls, of_graph = share * ratio, 1.0 - share
    variance = 0.04 * (of_walls**2 + of_graph**2 + 2.0 * correlation * of_walls * of_graph)
    assert believed[1, 0, 0] >= variance * (1.0 - 1e-9) - 1e-15


def _two_estimates(n: int, ratio: float, seed: int) -> tuple[Array, Array, Array]:
    """The way between an estimate and a better one of the same poses, and their covariances: drawn as they say."""
    graph = _covariances(n, 0.1)
    root = np.linalg.cholesky((1.0 - ratio) * graph[1:])
    drawn = np.random.default_rng(seed).normal(size=(n - 1, 3, 1))
    return np.concatenate([np.zeros((1, 3)), (root @ drawn)[..., 0]]), graph, ratio * graph


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9])
def test_a_way_as_long_as_the_worse_estimate_knows_less_contradicts_nothing(ratio: float) -> None:
    way, graph, believed = _two_estimates(20_000, ratio, seed=0)
    assert variance_factor(way, graph, believed, 1e-9) == pytest.approx(1.0, abs=0.03)
    # Three times as far is nine times as far, squared.
    assert variance_factor(3.0 * way, graph, believed, 1e-9) == pytest.approx(9.0, rel=0.03)


def test_the_prior_holds_where_both_estimates_know_the_same() -> None:
    way, graph, _ = _two_estimates(5, 0.5, seed=1)
    squared = float((way[1:] * np.linalg.solve(graph[1:], way[1:, :, None])[..., 0]).sum())
    # No difference is expected: the sums are those of the prior, a tenth of 4 poses times 3.
    assert variance_factor(way, graph, graph, 0.1) == pytest.approx(max(1.0, (squared + 1.2) / 1.2), rel=1e-9)
    assert variance_factor(0.0 * way, graph, graph, 0.1) == 1.0


def test_a_single_pose_contradicts_nothing() -> None:
    assert variance_factor(np.zeros((1, 3)), np.eye(3)[None], np.eye(3)[None], 0.1) == 1.0


def test_what_a_person_is_told_of_the_claims() -> None:
    beyond = 11.3449 / 3.0  # χ² of three degrees of freedom that one in a hundred exceeds
    assert claims_warning(beyond - 1e-3, CONFIG, are_walls_believed=True) is None
    contradicted = claims_warning(beyond + 1e-3, CONFIG, are_walls_believed=True)
    assert contradicted is not None
    assert "walls and matches contradict each other" in contradicted.sentence
    unconfirmed = claims_warning(1.0, CONFIG, are_walls_believed=False)
    assert unconfirmed is not None
    assert "do not confirm" in unconfirmed.sentence


def test_covariances_that_are_none_judge_nothing() -> None:
    graph = _covariances(5, 0.1)
    walls = graph / 2.0**2
    graph[3, 2, 2] = -1e-9
    np.testing.assert_array_equal(believed_covariances(walls, graph, 0.5), walls)
