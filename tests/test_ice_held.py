"""How much wall holds a match: closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from graph.measurement import RelativePose
from iceg.ice import _held_kernels as kernels
from iceg.ice.config import CovarianceConfig, FalseMatchConfig, RefinementConfig
from iceg.ice.covariance import score_covariance
from iceg.ice.false_matches import allowing_for_chance
from iceg.ice.points import ScanPoints
from iceg.ice.refinement import evaluate_points
from tests.kernels import from_python
from tests.test_ice_covariance import map_of

lengths_of = from_python(kernels._lengths)
held_of = from_python(kernels._held)

F64 = NDArray[np.float64]


def levers_of(points: F64, normals: F64) -> F64:
    """(n, 3) derivatives of the distances of points by a step of the robot in its own frame."""
    turns: F64 = normals[:, 1] * points[:, 0] - normals[:, 0] * points[:, 1]
    return np.column_stack([normals, turns])


def held(points: F64, normals: F64, own_normals: F64 | None = None) -> tuple[F64, F64]:
    """(2, 3) directions and (2,) by how many metres of wall they are held."""
    lengths, directions, found = np.empty(len(points)), np.empty((2, 3)), np.empty(2)
    lengths_of(points, lengths)
    own = normals if own_normals is None else own_normals
    held_of(levers_of(points, normals), levers_of(points, own), lengths, directions, found)
    return directions, found


def corridor(across: float, ahead: float = 4.0) -> tuple[F64, F64]:
    """Points and normals of two walls of 6 m along x, 2 m apart, and so much of a wall across, in their middle."""
    line = np.linspace(-3.0, 3.0, 301)
    end = np.linspace(-across / 2, across / 2, 21)
    points = np.concatenate(
        [np.c_[line, np.full(301, -1.0)], np.c_[np.full(21, ahead), end], np.c_[line, np.ones(301)]]
    )
    return points, np.repeat([[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]], [301, 21, 301], axis=0)


@given(across=st.floats(0.05, 1.8))
def test_a_corridor_is_held_by_what_faces_along_it(across: float) -> None:
    directions, found = held(*corridor(across))
    np.testing.assert_allclose(found, [across, 12.0], rtol=1e-6)
    np.testing.assert_allclose(np.abs(directions[0, :2]), [1.0, 0.0], atol=1e-6)


@given(radius=st.floats(2.0, 20.0), spacing=st.floats(0.01, 0.05))
def test_along_a_curved_wall_nothing_holds_a_slide_that_turns_with_it(radius: float, spacing: float) -> None:
    angles = np.arange(-0.6, 0.6, spacing / radius)
    normals = -np.c_[np.cos(angles), np.sin(angles)]
    directions, found = held(np.array([-radius + 1.0, 0.0]) - radius * normals, normals)
    assert found[0] == pytest.approx(0.0, abs=1e-9)
    slide = directions[0] * np.sign(directions[0, 1])
    # The robot is radius - 1 off the middle: it goes along by as much as it turns about that.
    np.testing.assert_allclose(slide, [0.0, 1.0, 1.0 / (radius - 1.0)], atol=1e-6)


@given(turn=st.floats(-3.1, 3.1), seed=st.integers(0, 1000))
def test_the_least_and_the_most_turn_along(turn: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, normals = np.cumsum(rng.uniform(-0.2, 0.2, (40, 2)), axis=0), rng.normal(size=(40, 2))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    (one, by_one), (other, by_other) = held(points, normals), held(points @ R.T, normals @ R.T)
    np.testing.assert_allclose(by_other, by_one, rtol=1e-6, atol=1e-9)
    assert by_one[0] <= by_one[1]
    if by_one[1] - by_one[0] > 1e-3:
        np.testing.assert_allclose(np.abs(other[0, :2] @ (R @ one[0, :2])), 1.0, rtol=1e-6)


def test_what_was_matched_to_a_surface_that_faces_another_way_holds_nothing() -> None:
    points, normals = corridor(0.5)
    own = normals.copy()
    own[301:322] = [0.0, 1.0]
    assert held(points, normals, own)[1][0] < 0.01


def test_a_gap_is_no_wall() -> None:
    points = np.array([[0.0, 1.0], [0.1, 1.0], [0.3, 1.0], [1.0, 1.0]])
    lengths = np.empty(4)
    lengths_of(points, lengths)
    np.testing.assert_allclose(lengths, [0.05, 0.15, 0.1, 0.0])


def match_in(across: float) -> RelativePose:
    """Of a scan in that corridor to a map of itself."""
    points, normals = corridor(across)
    scan = ScanPoints(
        points=points, normals=normals, beams=np.arange(len(points), dtype=np.int32), spreads=np.ones(len(points))
    )
    local_map = map_of(scan)
    at = evaluate_points(scan, local_map, np.zeros(3), RefinementConfig())
    found = score_covariance(scan, local_map, at, RefinementConfig(), CovarianceConfig())
    return RelativePose(
        T_ref_cur=np.zeros(3),
        covariance=found.covariance,
        score=1.0,
        inliers=len(points),
        overlap=1.0,
        weak_directions=found.weak_directions,
        held=found.held,
    )


def from_guess(match: RelativePose, deviation: float) -> RelativePose:
    """The same, from a guess that nothing has measured and that is known to so many metres."""
    covariance = np.diag([deviation**2, deviation**2, 1e-4])
    return allowing_for_chance(match, np.zeros(3), covariance, FalseMatchConfig(), is_measured=False)


@pytest.mark.parametrize("across", [0.1, 0.2, 0.6, 1.8])
def test_a_match_says_how_much_wall_holds_it(across: float) -> None:
    found = match_in(across).held
    assert found is not None
    np.testing.assert_allclose(np.abs(found.directions[0]), [1.0, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(found.lengths, [across, 12.0], atol=0.02)


def test_a_post_holds_a_match_no_better_than_its_guess_allows() -> None:
    match = match_in(0.1)
    sure, unsure = from_guess(match, 0.01), from_guess(match, 0.2)
    assert sure.covariance[0, 0] < 0.01**2
    assert unsure.covariance[0, 0] == pytest.approx(20.0 * 0.2**3, rel=0.1)
    assert np.abs(unsure.weak_directions) == pytest.approx(np.array([[1.0, 0.0, 0.0]]), abs=1e-3)
    assert not len(sure.weak_directions)


def test_a_wall_across_holds_it_whatever_the_guess() -> None:
    match = match_in(1.8)
    sure, unsure = from_guess(match, 0.01), from_guess(match, 0.2)
    assert unsure.covariance[0, 0] < sure.covariance[0, 0] + 0.006**2
    assert not len(unsure.weak_directions)
