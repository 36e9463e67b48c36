"""How walls run on from piece to piece: straight, round or broken, and what points on them tell along them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from iceg.slam.joint._bend_kernels import bends_along
from iceg.slam.joint.covariance import Walls
from iceg.slam.joint_config import JointRefinementConfig

Array = NDArray[np.float64]


def bends_of(lines: Array, weights: Array | None = None, reach: float = 1.5) -> Array:
    found, order = np.empty((len(lines), 2)), np.argsort(lines[:, 0], kind="stable")
    bends_along(lines, np.ones(len(lines)) if weights is None else weights, order, reach, 0.9, 0.03, found)
    return found


def arc(radius: float, n: int, step: float = 0.5) -> Array:
    """Pieces of a wall around the origin, seen from within."""
    bearings = np.arange(n) * step / radius
    outwards = np.column_stack([np.cos(bearings), np.sin(bearings)])
    return np.hstack([radius * outwards, -outwards])


def straight(n: int, heading: float) -> Array:
    along = np.array([np.cos(heading), np.sin(heading)])
    return np.hstack([0.5 * np.arange(n)[:, None] * along, np.tile([-along[1], along[0]], (n, 1))])


def moved(lines: Array, x: float, y: float) -> Array:
    return np.asarray(lines + np.array([x, y, 0.0, 0.0]))


def turned(lines: Array, angles: Array) -> Array:
    c, s = np.cos(angles), np.sin(angles)
    x, y = lines[:, 2], lines[:, 3]
    return np.hstack([lines[:, :2], np.column_stack([c * x - s * y, s * x + c * y])])


@given(st.floats(3.0, 100.0), st.booleans())
def test_a_round_wall_bends_as_its_radius_says(radius: float, within: bool) -> None:
    lines = arc(radius, 12)
    if not within:  # seen from the other side, along it is the other way, and turned the other way
        lines[:, 2:] *= -1.0
    found = bends_of(lines)
    np.testing.assert_allclose(found[:, 0], 0.0, atol=1e-3)
    np.testing.assert_allclose(found[:, 1], (-1.0 if within else 1.0) / radius, rtol=0.05)


@given(st.floats(-3.0, 3.0), st.integers(0, 1000))
def test_a_straight_wall_runs_straighter_than_its_pieces(heading: float, seed: int) -> None:
    tilts = np.random.default_rng(seed).normal(0.0, 0.005, 40)
    found = bends_of(turned(straight(40, heading), tilts))
    left = tilts + found[:, 0]
    assert left[3:-3].std() < 0.7 * tilts[3:-3].std()
    assert np.abs(found[3:-3, 1]).max() < 0.02


def test_what_lies_on_no_curve_with_it_tells_a_piece_nothing() -> None:
    corner = np.vstack([straight(4, 0.0), moved(straight(4, np.pi / 2), 1.75, 0.25)])
    np.testing.assert_allclose(bends_of(corner), 0.0, atol=1e-12)
    niche = np.vstack([straight(4, 0.0), moved(straight(4, 0.0), 2.0, 0.2)])
    np.testing.assert_allclose(bends_of(niche), 0.0, atol=1e-12)
    alone = arc(5.0, 1)
    assert bends_of(alone).tolist() == [[0.0, 0.0]]
    assert bends_of(np.empty((0, 4))).shape == (0, 2)


def test_pieces_count_by_their_points_and_within_reach() -> None:
    lines = turned(straight(3, 0.0), np.array([0.0, 0.0, 0.05]))
    assert bends_of(lines, np.array([1.0, 1.0, 0.0]))[0].tolist() == [0.0, 0.0]
    assert bends_of(lines, reach=0.9)[0].tolist() == [0.0, 0.0]
    assert bends_of(lines)[2, 0] < -0.005


@pytest.mark.parametrize("radius", [np.inf, 10.0])
def test_what_lies_along_a_wall_tells_nothing_along_it(radius: float) -> None:
    """A pose turned about the centre of a round wall, or moved along a straight one; its pieces err by 5 mrad."""
    rng, n, each = np.random.default_rng(2), 40, 60
    lines = straight(n, 0.0) if np.isinf(radius) else arc(radius, n)
    piece = np.repeat(np.arange(n), each)
    along = rng.uniform(-0.25, 0.25, n * each)
    tangents = np.column_stack([lines[:, 3], -lines[:, 2]])
    placed = lines[piece, :2] + along[:, None] * tangents[piece]
    if np.isfinite(radius):
        placed *= radius / np.hypot(*placed.T)[:, None]
    walls = Walls(
        placed=placed,
        errors=np.zeros_like(placed),
        piece_of=piece,
        lines=turned(lines, rng.normal(0.0, 0.005, n)),
        residuals=np.zeros(n * each),
        weights=np.ones(n * each),
        roughness=0.005,
        on_walls=1.0,
        residual=0.01,
        bends=np.zeros((n, 2)),
    )
    # Two poses see the same points; of the first the lines know nothing but what it tells.
    poses = np.array([[0.0, 1.0, 0.0]] * 2) if np.isinf(radius) else np.zeros((2, 3))
    slide = np.array([1.0, 0.0, 0.0]) if np.isinf(radius) else np.array([0.0, 0.0, 1.0 / radius])
    told = [
        slide @ each_way.normal_equations(poses, np.array([0, 0, n * each])).diagonal[1] @ slide
        for each_way in (walls, walls.running_on(JointRefinementConfig()))
    ]
    assert told[1] < 0.5 * told[0]
