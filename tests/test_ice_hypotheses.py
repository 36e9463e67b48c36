"""Hypotheses: pairs of features against a slow twin, the feasible area, and the searches without pairs."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from graph.se2 import between, compose, wrap_angle
from iceg.ice.config import HypothesisConfig, IceConfigError
from iceg.ice.features import CORNER, END_OF_WALL, INTERSECTION, FeatureRows
from iceg.ice.hypotheses import SearchWindow, distinct, pair_hypotheses, search_window, widened
from iceg.ice.search import breed_hypotheses, evolve_hypotheses, grid_hypotheses

F64 = NDArray[np.float64]
EVERYWHERE = SearchWindow(T_ref_guess=np.zeros(3), translation=50.0, rotation=np.pi)
poses = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-np.pi, np.pi)).map(np.array)


def some_features(n: int, seed: int) -> FeatureRows:
    """Corners, ends with either wall, and intersections, all over a room."""
    rng = np.random.default_rng(seed)
    kinds = rng.integers(0, 3, n).astype(np.int8)
    rows = np.zeros((n, 10))
    rows[:, :2] = rng.uniform(-5, 5, (n, 2))
    rows[:, 2:4] = rng.uniform(-np.pi, np.pi, (n, 2))
    ends = np.flatnonzero(kinds == END_OF_WALL)
    rows[ends, 2 + rng.integers(0, 2, len(ends))] = np.nan
    rows[:, [4, 6, 7]] = 1e-4
    rows[:, 8], rows[:, 9] = 1.0, np.hypot(rows[:, 0], rows[:, 1])
    return FeatureRows(kinds=kinds, rows=rows)


def moved(features: FeatureRows, pose: F64) -> FeatureRows:
    rows = features.rows.copy()
    c, s = np.cos(pose[2]), np.sin(pose[2])
    rows[:, :2] = pose[:2] + features.rows[:, :2] @ np.array([[c, s], [-s, c]])
    rows[:, 2:4] += pose[2]
    return FeatureRows(kinds=features.kinds, rows=rows)


def twin(new: FeatureRows, ref: FeatureRows, window: SearchWindow, opening: float) -> F64:
    found = []
    for kind, row in zip(new.kinds, new.rows, strict=True):
        for ref_kind, ref_row in zip(ref.kinds, ref.rows, strict=True):
            if kind != ref_kind and CORNER not in {int(kind), int(ref_kind)}:
                continue
            turns = wrap_angle(ref_row[2:4] - row[2:4])
            turns = turns[np.isfinite(turns)]
            if len(turns) == 0 or (len(turns) == 2 and abs(wrap_angle(float(turns[1] - turns[0]))) > opening):
                continue
            turn = float(np.arctan2(np.sin(turns).sum(), np.cos(turns).sum()))
            R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            offset = ref_row[:2] - R @ row[:2]
            inside = (np.abs(offset - window.T_ref_guess[:2]) <= window.translation).all()
            if inside and abs(wrap_angle(turn - window.T_ref_guess[2])) <= window.rotation:
                found.append([*offset, turn])
    return np.array(found).reshape(-1, 3)


@pytest.mark.parametrize("seed", range(4))
def test_pairs_against_a_slow_twin(seed: int) -> None:
    new, ref = some_features(20, seed), some_features(40, seed + 100)
    window = SearchWindow(T_ref_guess=np.array([0.5, -0.5, 0.3]), translation=3.0, rotation=1.2)
    config = HypothesisConfig()
    got = pair_hypotheses(new, ref, window, config)
    np.testing.assert_array_equal(got[0], window.T_ref_guess)
    expected = twin(new, ref, window, config.opening_gate)
    assert len(expected) > 5
    np.testing.assert_allclose(got[1:], expected, atol=1e-9)


@given(poses, st.integers(0, 50))
def test_the_true_pose_is_among_the_hypotheses(pose: F64, seed: int) -> None:
    features = some_features(8, seed)
    errors = pair_hypotheses(features, moved(features, pose), EVERYWHERE, HypothesisConfig()) - pose
    errors[:, 2] = wrap_angle(errors[:, 2])
    assert (np.abs(errors).max(axis=1) < 1e-9).sum() >= 8


@given(poses, poses, st.integers(0, 50))
def test_moving_world_and_robot_moves_the_hypotheses(world: F64, robot: F64, seed: int) -> None:
    """T_ref_cur does not change when the reference frame moves by T and everything in it with it."""
    new, ref = some_features(6, seed), moved(some_features(6, seed), robot)
    plain = pair_hypotheses(new, ref, EVERYWHERE, HypothesisConfig())[1:]
    other = pair_hypotheses(new, moved(ref, world), EVERYWHERE, HypothesisConfig())[1:]
    difference = between(compose(world, plain), other)
    np.testing.assert_allclose(difference, 0.0, atol=1e-6)


def test_a_corner_may_match_a_wall_end_but_an_intersection_may_not() -> None:
    def one(kind: int) -> FeatureRows:
        row = np.array([[1.0, 2.0, 0.1, np.nan if kind == END_OF_WALL else 1.7, 1e-4, 0, 1e-4, 1e-4, 1, 2.2]])
        return FeatureRows(kinds=np.array([kind], np.int8), rows=row)

    def pairs(a: int, b: int) -> int:
        return len(pair_hypotheses(one(a), one(b), EVERYWHERE, HypothesisConfig())) - 1

    assert pairs(CORNER, END_OF_WALL) == pairs(END_OF_WALL, CORNER) == pairs(CORNER, INTERSECTION) == 1
    assert pairs(END_OF_WALL, INTERSECTION) == 0


def test_without_features_only_the_guess_is_left() -> None:
    nothing = FeatureRows(kinds=np.empty(0, np.int8), rows=np.empty((0, 10)))
    assert pair_hypotheses(nothing, some_features(5, 0), EVERYWHERE, HypothesisConfig()).tolist() == [[0.0, 0.0, 0.0]]


def test_the_window_follows_the_covariance_of_the_guess() -> None:
    config = HypothesisConfig(sigmas=3.0, min_window=0.15, min_turn=0.1)
    window = search_window(np.zeros(3), np.diag([0.04, 0.01, 0.09]), config)
    assert window.translation == pytest.approx(0.6)
    assert window.rotation == pytest.approx(0.9)
    small = search_window(np.zeros(3), np.diag([1e-6, 1e-6, 1e-6]), config)
    assert (small.translation, small.rotation) == (0.15, 0.1)
    assert search_window(np.zeros(3), np.eye(3) * 100, config).rotation == np.pi
    wide = widened(small, config)
    assert (wide.translation, wide.rotation) == (config.wide_window, config.wide_turn)


def test_headings_wrap_at_the_edge_of_the_window() -> None:
    window = SearchWindow(T_ref_guess=np.array([0.0, 0.0, 3.1]), translation=1.0, rotation=0.2)
    assert window.contains(np.array([0.5, -0.5, -3.1]))
    assert not window.contains(np.array([0.5, -0.5, -2.8]))
    assert not window.contains(np.array([0.0, 1.3, 3.1]))


def test_distinct_hypotheses_keep_their_order() -> None:
    hypotheses = np.array([[0, 0, 0], [0.1, 0, 0.05], [0.1, 0, 2 * np.pi - 0.01], [1, 0, 0], [0, 0, 0.5]], float)
    assert distinct(hypotheses, np.arange(5), 3) == [0, 3, 4]
    assert distinct(hypotheses, np.arange(4, -1, -1), 2) == [4, 3]


def test_the_grid_leaves_no_pose_out() -> None:
    config = HypothesisConfig(field_sigma=0.2)
    window = SearchWindow(T_ref_guess=np.array([1.0, 2.0, 3.0]), translation=0.7, rotation=0.6)
    grid = grid_hypotheses(window, config)
    np.testing.assert_array_equal(grid[0], window.T_ref_guess)
    for pose in window.T_ref_guess + np.random.default_rng(0).uniform(-1, 1, (50, 3)) * [0.7, 0.7, 0.6]:
        off = np.abs(grid - pose)
        off[:, 2] = np.abs(wrap_angle(grid[:, 2] - pose[2]))
        assert (off <= [0.1 + 1e-9, 0.1 + 1e-9, 0.05 + 1e-9]).all(axis=1).any()


@pytest.mark.parametrize("search", [evolve_hypotheses, breed_hypotheses])
def test_evolution_finds_a_peak_and_repeats_itself(search: Callable[..., F64]) -> None:
    window = SearchWindow(T_ref_guess=np.array([0.0, 0.0, 3.0]), translation=2.0, rotation=1.0)
    peak = np.array([1.2, -0.7, -2.9])

    def fitness(candidates: F64) -> F64:
        off = candidates - peak
        off[:, 2] = wrap_angle(off[:, 2])
        return np.asarray(np.exp(-0.5 * (off**2).sum(axis=1) / 0.3**2), dtype=np.float64)

    found = search(window, fitness, HypothesisConfig(seed=3))
    best = found[fitness(found).argmax()]
    np.testing.assert_allclose(best, peak, atol=0.02)
    np.testing.assert_array_equal(found, search(window, fitness, HypothesisConfig(seed=3)))
    assert all(window.contains(pose) for pose in found)


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(IceConfigError, match="found candidates 0, expected 1 or more"):
        HypothesisConfig(candidates=0)
    with pytest.raises(IceConfigError, match="ranking_points"):
        HypothesisConfig(ranking_points=5)
