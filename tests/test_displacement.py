"""What it adds to covariances that the robot may have been carried: the law of total variance."""

import numpy as np
import pytest

from iceg.slam.broken_path.displacement import displaced_covariances, displacements
from iceg.slam.broken_path.path_break import Break, Outcome

_N = 40


def _path() -> np.ndarray:
    return np.column_stack([np.linspace(0.0, 12.0, _N), np.linspace(0.0, 5.0, _N), np.zeros(_N)])


def _breaks(*probabilities: tuple[int, float]) -> list[Break]:
    return [Break(key=k, outcome=Outcome.DOUBTFUL, reason="", probability=p) for k, p in probabilities]


def test_the_mixture_of_a_robot_that_was_carried_and_one_that_was_not_has_this_variance() -> None:
    rng, path, p = np.random.default_rng(5), _path(), 0.3
    n = 400_000
    ends = rng.integers(0, _N, (2, n))
    away = path[ends[0], :2] - path[ends[1], :2]
    away = np.where(rng.random(n) < 0.5, away.T, away.T[::-1])  # either axis alike: nobody knows which way
    is_carried = rng.random(n) < p
    errors = np.where(is_carried, away, rng.normal(0.0, 0.1, (2, n)))
    (found,) = displacements(_breaks((10, p)), path)
    assert found.key == 10
    assert found.variances[:2] + (1.0 - p) * 0.01 == pytest.approx(errors.var(axis=1), rel=0.02)
    headings = np.where(is_carried, rng.uniform(-np.pi, np.pi, n), 0.0)
    assert found.variances[2] == pytest.approx(headings.var(), rel=0.02)


def test_what_lies_before_it_is_not_displaced_and_what_follows_two_by_both() -> None:
    found = displacements(_breaks((10, 0.2), (20, 0.1)), _path())
    grown = displaced_covariances(found, _N)
    assert not grown[:10].any()
    assert grown[10:20] == pytest.approx(np.broadcast_to(np.diag(found[0].variances), (10, 3, 3)))
    assert grown[20] == pytest.approx(np.diag(found[0].variances + found[1].variances))


def test_a_break_that_is_settled_displaces_nothing() -> None:
    assert displacements(_breaks((10, 0.0)), _path()) == ()
