"""Where the walls claim to know more than the graph can have led them to, they are believed less, or not at all; what
the graph knows better it is believed."""

import numpy as np
import pytest
from numpy.typing import NDArray

from iceg.slam.joint.wall_claims import CREDIBLE, believed_covariances

Array = NDArray[np.float64]
_GAIN = 3.0


def _covariances(n: int, scale: float, seed: int = 0) -> Array:
    """Random ones of one size; none for the first pose, which the others are relative to."""
    roots = np.random.default_rng(seed).normal(size=(n, 3, 3))
    found = np.asarray(scale**2 * (roots @ np.swapaxes(roots, 1, 2) + 0.3 * np.eye(3)), dtype=np.float64)
    found[0] = 1e-10 * np.eye(3)
    return found


def test_a_claim_within_reason_stays_as_it_is() -> None:
    graph = _covariances(20, 0.1)
    walls = graph / 2.5**2
    believed = believed_covariances(walls, graph, _GAIN)
    assert believed is not None
    np.testing.assert_allclose(believed, walls, rtol=1e-12)


def test_a_direction_that_would_be_known_too_well_is_widened_and_one_known_worse_than_by_the_graph_narrowed() -> None:
    graph = _covariances(9, 0.1)
    root = np.asarray(np.linalg.cholesky(graph), dtype=np.float64)
    walls = root @ np.diag([0.5, 0.04, 4.0]) @ np.swapaxes(root, 1, 2)
    walls[0] = graph[0]
    believed = believed_covariances(walls, graph, _GAIN)
    assert believed is not None
    expected = root[1:] @ np.diag([0.5, 1.0 / _GAIN**2, 1.0]) @ np.swapaxes(root[1:], 1, 2)
    np.testing.assert_allclose(believed[1:], expected, rtol=1e-9, atol=1e-14)
    np.testing.assert_array_equal(believed[0], walls[0])


@pytest.mark.parametrize(("too_sure", "is_believed"), [(4, True), (6, False)])
def test_where_most_poses_would_be_known_too_well_nothing_is_believed(too_sure: int, is_believed: bool) -> None:
    graph = _covariances(11, 0.1)
    walls = graph / 2.0**2
    walls[1 : 1 + too_sure] = graph[1 : 1 + too_sure] / (2.0 * CREDIBLE) ** 2
    believed = believed_covariances(walls, graph, _GAIN)
    assert (believed is not None) == is_believed
    if believed is not None:
        assert np.linalg.eigvalsh(believed[1:] - graph[1:] / (1.001 * _GAIN) ** 2).min() > 0.0


def test_covariances_that_are_none_judge_nothing() -> None:
    graph = _covariances(5, 0.1)
    walls = graph / 2.0**2
    graph[3, 2, 2] = -1e-9
    believed = believed_covariances(walls, graph, _GAIN)
    assert believed is not None
    np.testing.assert_array_equal(believed, walls)
