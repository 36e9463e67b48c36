"""Poses between the graph's optimum and the walls' are as uncertain as the way they went says; what the graph knows
better it is believed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from iceg.slam.joint.wall_claims import believed_covariances
from iceg.slam.joint_config import JointRefinementConfig

Array = NDArray[np.float64]
CONFIG = JointRefinementConfig()


def _believed(walls: Array, graph: Array, share: float) -> Array:
    """Of a claim that is credible."""
    believed = believed_covariances(walls, graph, share, CONFIG)
    assert believed is not None
    return believed


def _covariances(n: int, scale: float, seed: int = 0) -> Array:
    """Random ones of one size; none for the first pose, which the others are relative to."""
    roots = np.random.default_rng(seed).normal(size=(n, 3, 3))
    found = np.asarray(scale**2 * (roots @ np.swapaxes(roots, 1, 2) + 0.3 * np.eye(3)), dtype=np.float64)
    found[0] = 1e-10 * np.eye(3)
    return found


def test_the_walls_are_believed_where_the_poses_went_all_of_the_way() -> None:
    graph = _covariances(20, 0.1)
    walls = graph / 2.5**2
    np.testing.assert_allclose(_believed(walls, graph, 1.0), walls, rtol=1e-12)


def test_the_graph_is_believed_where_the_poses_did_not_go() -> None:
    graph = _covariances(20, 0.1)
    believed = _believed(_covariances(20, 0.05, seed=1), graph, 0.0)
    np.testing.assert_allclose(believed[1:], graph[1:], rtol=1e-9)


def test_part_of_the_way_and_a_direction_that_the_graph_knows_better() -> None:
    graph = _covariances(9, 0.1)
    root = np.asarray(np.linalg.cholesky(graph), dtype=np.float64)
    walls = root @ np.diag([0.5, 0.04, 4.0]) @ np.swapaxes(root, 1, 2)
    walls[0] = graph[0]
    believed = _believed(walls, graph, 0.75)
    # 3/4 of the walls' variance, that of the graph where it is the smaller one, and 1/4 of the graph's.
    expected = root[1:] @ np.diag([0.625, 0.28, 1.0]) @ np.swapaxes(root[1:], 1, 2)
    np.testing.assert_allclose(believed[1:], expected, rtol=1e-9, atol=1e-14)
    np.testing.assert_array_equal(believed[0], walls[0])


@given(share=st.floats(0.0, 1.0), correlation=st.floats(-1.0, 1.0), ratio=st.floats(0.25, 1.0))
def test_it_bounds_the_error_however_those_of_walls_and_graph_hang_together(
    share: float, correlation: float, ratio: float
) -> None:
    graph = np.tile(0.04 * np.eye(3), (2, 1, 1))
    believed = _believed(ratio**2 * graph, graph, share)
    # The error of a pose that went the share a of the way: a times that of the walls and 1 - a times that of the graph.
    of_walls, of_graph = share * ratio, 1.0 - share
    variance = 0.04 * (of_walls**2 + of_graph**2 + 2.0 * correlation * of_walls * of_graph)
    assert believed[1, 0, 0] >= variance * (1.0 - 1e-9) - 1e-15


@pytest.mark.parametrize(("too_sure", "share", "is_believed"), [(4, 0.5, True), (6, 0.5, False), (6, 0.9, True)])
def test_a_claim_far_beyond_the_graph_needs_poses_that_were_pulled(
    too_sure: int, share: float, is_believed: bool
) -> None:
    graph = _covariances(11, 0.1)
    walls = graph / 2.0**2
    walls[1 : 1 + too_sure] = graph[1 : 1 + too_sure] / (2.0 * CONFIG.credible_ratio) ** 2
    assert (believed_covariances(walls, graph, share, CONFIG) is not None) == is_believed


def test_covariances_that_are_none_judge_nothing() -> None:
    graph = _covariances(5, 0.1)
    walls = graph / 2.0**2
    graph[3, 2, 2] = -1e-9
    np.testing.assert_array_equal(_believed(walls, graph, 0.5), walls)
