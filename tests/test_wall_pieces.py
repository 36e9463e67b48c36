"""Pieces of wall that a run keeps: where they are, how far they reach, and from how many key poses they were seen."""

import math

import numpy as np
import pytest

from graph.se2 import compose, expmap
from iceg.slam.joint.covariance import Walls
from iceg.slam.joint.refinement import refine_jointly
from iceg.slam.joint.wall_pieces import WallPieces
from iceg.slam.joint_config import JointRefinementConfig
from tests.test_joint_refinement import ROOM, chain, drive, room_clouds

FLOOR, POST, NONE = 0, 1, -1


def walls() -> Walls:
    """A piece along x seen upwards and one along y seen to the right; the last point of the first lies far off."""
    return Walls(
        placed=np.array([[0.0, 0.01], [0.2, -0.01], [1.0, 0.0], [0.4, 0.0], [0.9, 0.2], [5.0, 5.0], [1.0, 0.3]]),
        errors=np.zeros((7, 2)),
        piece_of=np.array([FLOOR, FLOOR, POST, FLOOR, FLOOR, NONE, POST]),
        lines=np.array([[0.2, 0.0, 0.0, 1.0], [1.0, 0.1, 1.0, 0.0]]),
        residuals=np.array([0.01, -0.01, 0.0, 0.0, 0.2, 0.0, 0.0]),
        weights=np.array([0.9, 0.9, 1.0, 1.0, 0.02, 0.0, 1.0]),
        roughness=0.005,
        on_walls=0.9,
        residual=0.01,
        bends=np.zeros((2, 2)),
    )


def test_pieces_reach_as_far_as_their_points() -> None:
    pieces = WallPieces.of(walls(), np.ones(7), np.array([0, 2, 4, 7]), np.zeros(3), 0.5)
    np.testing.assert_allclose(pieces.ends[FLOOR], [[0.0, 0.0], [0.4, 0.0]])  # what was seen lies to the left
    np.testing.assert_allclose(pieces.ends[POST], [[1.0, 0.3], [1.0, 0.0]])
    assert pieces.points.tolist() == [3, 2]
    assert pieces.key_poses.tolist() == [2, 2]
    assert pieces.deviations == pytest.approx([math.sqrt(2e-4 / 3), 0.0])


def test_pieces_are_placed_in_the_map() -> None:
    pieces = WallPieces.of(walls(), np.ones(7), np.array([0, 7]), np.array([10.0, 0.0, math.pi / 2]), 0.5)
    np.testing.assert_allclose(pieces.ends[FLOOR], [[10.0, 0.0], [10.0, 0.4]], atol=1e-12)
    assert pieces.key_poses.tolist() == [1, 1]


def test_a_refined_room_has_its_walls_where_its_poses_are() -> None:
    truth = drive()
    guess = compose(truth, expmap(0.01 * np.random.default_rng(3).normal(size=truth.shape)))
    guess[0] = truth[0]
    refined = refine_jointly(chain(truth, (0.02, 0.02, 0.01)), guess, room_clouds(truth), JointRefinementConfig())
    ends = refined.walls.ends[refined.walls.points > 8].reshape(-1, 2)
    to_walls = np.stack([ends[:, 0] - ROOM[0, 0], ROOM[1, 0] - ends[:, 0], ends[:, 1] - ROOM[0, 1], 3.0 - ends[:, 1]])
    assert len(ends) > 30
    assert np.abs(to_walls).min(axis=0).max() < 0.04
