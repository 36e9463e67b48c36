"""Pairwise consistency: cycles judged by their covariance, cliques against brute force."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2

from graph.consistency import (
    ConsistencyConfig,
    consistent_closures,
    cumulative_covariances,
    maximum_clique,
    pairwise_consistency,
)
from graph.errors import GraphError
from graph.factors import Factor
from graph.se2 import adjoint, between, chain_covariance, compose, expmap, inverse, inverse_covariance, logmap

Array = NDArray[np.float64]

STEP = np.diag([0.02, 0.02, 0.01]) ** 2
LOOP = np.diag([0.03, 0.03, 0.01]) ** 2


def chain(n: int, seed: int) -> tuple[list[Factor], Array, Array]:
    """Odometry along a winding way, the poses it leads to, and the truth."""
    rng = np.random.default_rng(seed)
    truth, poses, factors = [np.zeros(3)], [np.zeros(3)], []
    for k in range(n - 1):
        step = np.array([0.5, 0.0, rng.choice([-0.3, 0.0, 0.3])])
        measured = compose(step, expmap(np.sqrt(np.diag(STEP)) * rng.normal(size=3)))
        truth.append(compose(truth[-1], step))
        poses.append(compose(poses[-1], measured))
        factors.append(Factor(kind="odometry", i=k, j=k + 1, T_i_j=measured, covariance=STEP))
    return factors, np.array(poses), np.array(truth)


def closures(truth: Array, pairs: list[tuple[int, int]], seed: int) -> list[Factor]:
    rng = np.random.default_rng(seed)
    return [
        Factor(
            kind="closure",
            i=i,
            j=j,
            T_i_j=compose(between(truth[i], truth[j]), expmap(np.sqrt(np.diag(LOOP)) * rng.normal(size=3))),
            covariance=LOOP,
        )
        for i, j in pairs
    ]


def test_chain_covariances_are_differences() -> None:
    factors, poses, _ = chain(20, 0)
    cumulative = cumulative_covariances(factors, poses)
    carry = adjoint(inverse(poses[12]))
    expected = chain_covariance([factor.T_i_j for factor in factors[5:12]], np.array([STEP] * 7))
    np.testing.assert_allclose(carry @ (cumulative[12] - cumulative[5]) @ carry.T, expected, atol=1e-12)


def test_two_factors_of_one_step_add_and_one_may_look_back() -> None:
    factors, poses, _ = chain(4, 0)
    once = cumulative_covariances(factors, poses)
    backwards = [
        Factor(
            kind="ice",
            i=factor.j,
            j=factor.i,  # type: ignore[arg-type]
            T_i_j=inverse(factor.T_i_j),
            covariance=inverse_covariance(factor.T_i_j, STEP),
        )
        for factor in factors
    ]
    np.testing.assert_allclose(cumulative_covariances(backwards, poses), once, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(cumulative_covariances([*factors, *backwards], poses), once / 2, rtol=1e-6, atol=1e-12)


def test_true_closures_agree_as_often_as_the_gate_says() -> None:
    disagree = total = 0
    for seed in range(15):
        factors, poses, truth = chain(60, seed)
        true = closures(truth, [(k, 40 + k) for k in range(0, 20, 2)], seed + 1000)
        cumulative = cumulative_covariances(factors, poses)
        agree = pairwise_consistency(true, poses, cumulative, 0.95)
        above = np.triu_indices(len(true), 1)
        disagree += int((~agree[above]).sum())
        total += len(above[0])
    assert 0.02 < disagree / total < 0.09


def test_the_direction_of_a_closure_does_not_matter() -> None:
    factors, poses, truth = chain(60, 3)
    forward = closures(truth, [(k, 40 + k) for k in range(15)], 5)
    backward = [
        Factor(
            kind="closure",
            i=c.j,
            j=c.i,  # type: ignore[arg-type]
            T_i_j=inverse(c.T_i_j),
            covariance=inverse_covariance(c.T_i_j, LOOP),
        )
        for c in forward
    ]
    cumulative = cumulative_covariances(factors, poses)
    np.testing.assert_array_equal(
        pairwise_consistency(forward, poses, cumulative, 0.6), pairwise_consistency(backward, poses, cumulative, 0.6)
    )


def twin_consistency(closures: list[Factor], poses: Array, cumulative: Array) -> Array:
    """(m, m) the squared norm of the cycle through each two closures, by its definition."""
    norms = np.zeros((len(closures), len(closures)))
    errors = [compose(compose(poses[c.i], c.T_i_j), inverse(poses[c.j])) for c in closures]
    own = []
    for c in closures:
        carry = adjoint(compose(poses[c.i], c.T_i_j))
        own.append(carry @ c.covariance @ carry.T)
    for a, b in combinations(range(len(closures)), 2):
        (i_a, j_a), (i_b, j_b) = ((closures[k].i or 0, closures[k].j) for k in (a, b))
        carry = adjoint(errors[a])
        here = cumulative[max(i_a, i_b)] - cumulative[min(i_a, i_b)]
        there = cumulative[max(j_a, j_b)] - cumulative[min(j_a, j_b)]
        error = logmap(compose(errors[a], inverse(errors[b])))
        norms[a, b] = norms[b, a] = error @ np.linalg.solve(own[a] + own[b] + here + carry @ there @ carry.T, error)
    return norms


@pytest.mark.parametrize("half_turn", [False, True])
def test_consistency_is_that_of_its_definition(half_turn: bool) -> None:
    # Far ends, so that the chain between them decides; with a half turn, errors on either side of ±π say the same.
    factors, poses, truth = chain(90, 4)
    rng = np.random.default_rng(6)
    pairs = [(int(i), int(j)) for i, j in zip(rng.integers(0, 40, 20), rng.integers(50, 90, 20), strict=True)]
    found = closures(truth, pairs, 7)
    if half_turn:
        turn = np.array([1.0, -2.0, 0.06 - np.pi])
        found = [
            Factor(
                kind="closure",
                i=c.i,
                j=c.j,
                T_i_j=compose(between(poses[c.i or 0], turn), compose(poses[c.i or 0], c.T_i_j)),
                covariance=LOOP,
            )
            for c in found
        ]
    cumulative = cumulative_covariances(factors, poses)
    norms = twin_consistency(found, poses, cumulative)
    agree = pairwise_consistency(found, poses, cumulative, 0.5)
    np.testing.assert_array_equal(agree, norms <= chi2.isf(0.5, 3))
    assert 0.1 < agree[np.triu_indices(20, 1)].mean() < 0.9


def test_false_closures_are_left_out() -> None:
    factors, poses, truth = chain(120, 7)
    true = closures(truth, [(k, 80 + k) for k in range(40)], 8)
    rng = np.random.default_rng(9)
    false = [
        Factor(kind="closure", i=k, j=80 + k, T_i_j=np.array([*rng.uniform(-20, 20, 2), 0.0]), covariance=LOOP)
        for k in range(0, 40, 2)
    ]
    # Five of them agree with one another, as similar places do (perceptual aliasing).
    off = np.array([3.0, 1.0, 0.2])
    false += [
        Factor(kind="closure", i=k, j=80 + k, T_i_j=compose(off, between(truth[k], truth[80 + k])), covariance=LOOP)
        for k in range(5)
    ]
    kept = consistent_closures([*true, *false], poses, factors)
    assert kept.tolist() == [True] * len(true) + [False] * len(false)


def brute_force(consistent: NDArray[np.bool_]) -> int:
    n = len(consistent)
    for size in range(n, 0, -1):
        for chosen in combinations(range(n), size):
            if all(consistent[a, b] for a, b in combinations(chosen, 2)):
                return size
    return 0


@given(st.integers(0, 10), st.floats(0.0, 1.0), st.integers(0, 2**16))
def test_the_clique_is_the_largest(n: int, density: float, seed: int) -> None:
    drawn = np.triu(np.random.default_rng(seed).random((n, n)) < density, 1)
    consistent = drawn | drawn.T
    members = np.flatnonzero(maximum_clique(consistent))
    assert all(consistent[a, b] for a, b in combinations(members, 2))
    assert len(members) == brute_force(consistent)
    assert maximum_clique(consistent).tolist() == maximum_clique(consistent).tolist()


@given(st.integers(0, 2**16))
def test_greedy_finds_a_planted_clique(seed: int) -> None:
    rng = np.random.default_rng(seed)
    drawn = np.triu(rng.random((120, 120)) < 0.2, 1)
    consistent = drawn | drawn.T
    planted = rng.permutation(120)[:70]
    consistent[np.ix_(planted, planted)] = True
    members = maximum_clique(consistent, exact_up_to=0)
    assert all(consistent[a, b] for a, b in combinations(np.flatnonzero(members), 2))
    assert members.sum() >= 70


def test_nothing_to_choose_from_and_misuse() -> None:
    factors, poses, truth = chain(10, 0)
    assert consistent_closures([], poses, factors).shape == (0,)
    assert consistent_closures(closures(truth, [(0, 9)], 1), poses, factors).tolist() == [True]
    wrong = Factor(kind="closure", i=0, j=12, T_i_j=np.zeros(3), covariance=LOOP)
    with pytest.raises(GraphError, match="closure 0→12 is no closure between two of the 10 poses"):
        consistent_closures([wrong], poses, factors)
    with pytest.raises(GraphError, match="probability"):
        ConsistencyConfig(probability=1.0)
