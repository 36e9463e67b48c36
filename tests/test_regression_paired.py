"""Whether a difference between two tables is chance: closed forms, and what a test must not depend on."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iceg.evaluation.regression.paired import by_family, chance, interval, scatter

_DIFFERENCES = st.lists(st.floats(-10.0, 10.0).map(lambda value: round(value, 3)), min_size=1, max_size=10)


def _mcnemar(gained: int, lost: int) -> float:
    """Two-sided exact McNemar test: twice the smaller tail of a fair coin."""
    n = gained + lost
    tail: float = sum(math.comb(n, k) for k in range(min(gained, lost) + 1)) / 2.0**n
    return min(1.0, 2.0 * tail)


@pytest.mark.parametrize("n", [1, 3, 8, 12])
def test_differences_all_alike_and_of_one_sign_have_one_chance_in_two_to_the_n(n: int) -> None:
    assert chance(np.full(n, 0.3)) == pytest.approx(2 / 2**n)


@given(gained=st.integers(0, 8), lost=st.integers(0, 8))
def test_counts_are_judged_as_mcnemar_would(gained: int, lost: int) -> None:
    found = chance(np.array([1.0] * gained + [-1.0] * lost + [0.0] * 5))
    assert found == pytest.approx(_mcnemar(gained, lost) if gained + lost else 1.0)


@given(differences=_DIFFERENCES, data=st.data())
def test_neither_order_nor_sign_nor_unit_matters(differences: list[float], data: st.DataObject) -> None:
    found = chance(np.array(differences))
    assert 0.0 < found <= 1.0
    assert chance(np.array(data.draw(st.permutations(differences)))) == found
    assert chance(-np.array(differences)) == found
    assert chance(4.0 * np.array(differences)) == found
    assert chance(np.array([*differences, 0.0])) == found


def test_no_difference_is_chance() -> None:
    assert chance(np.zeros(7)) == 1.0
    assert chance(np.empty(0)) == 1.0


def test_many_differences_are_flipped_at_random_the_same_every_time() -> None:
    few = np.array([0.417, -0.103, 0.311, 0.229, -0.187, 0.523, 0.139, 0.347, 0.241, -0.293])
    many = np.concatenate([few, np.full(8, 1e-9)])  # these do not matter, but are too many to flip in every way
    assert chance(many) == pytest.approx(chance(few), abs=0.02)
    assert chance(many) == chance(many)
    assert chance(np.full(60, 0.1)) < 1e-4


def test_cells_that_differ_by_their_noise_alone_are_one_sample() -> None:
    sums = by_family([("a", 1.0), ("b", 0.5), ("a", 2.0), ("a", -0.5)])
    np.testing.assert_allclose(sums, [2.5, 0.5])
    assert chance(by_family([("a", 1.0)] * 20)) == 1.0


def test_the_interval_of_a_ratio_closes_where_all_agree_and_holds_the_mean() -> None:
    assert interval(np.full(9, math.log(0.8)), np.ones(9)) == pytest.approx((0.8, 0.8))
    logs = np.random.default_rng(3).normal(0.1, 0.5, 40)
    low, high = interval(logs, np.ones(40))
    spread = 1.96 * logs.std() / math.sqrt(40)
    assert low == pytest.approx(math.exp(logs.mean() - spread), rel=0.05)
    assert high == pytest.approx(math.exp(logs.mean() + spread), rel=0.05)


def test_scatter_is_that_of_the_logarithm_over_the_seeds() -> None:
    found = scatter({"a": [0.1, 0.1 * math.e], "b": [0.2]})
    assert found == {"a": pytest.approx(math.sqrt(0.5))}
