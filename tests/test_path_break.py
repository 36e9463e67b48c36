"""Steps of the path do not hold together what a sudden loss has torn apart."""

import numpy as np
import pytest

from graph.factors import Factor
from iceg.slam.broken_path.lost_steps import without_lost_steps
from iceg.slam.broken_path.path_break import Break, FailureKind, Outcome, TrackingFailure, probability
from iceg.slam.config import LoopClosureConfig
from iceg.slam.track import UNKNOWN_STEP

_STEP = np.array([0.5, 0.0, 0.1])
_ODOMETRY = np.diag([0.02, 0.01, 0.01]) ** 2


def _chain(n: int) -> list[Factor]:
    prior = Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=1e-6 * np.eye(3))
    steps = [Factor(kind="odometry", i=k - 1, j=k, T_i_j=_STEP, covariance=_ODOMETRY) for k in range(1, n)]
    return [prior, *steps, Factor(kind="ice", i=0, j=1, T_i_j=_STEP, covariance=1e-4 * np.eye(3))]


def _torn(*breaks: Break) -> list[tuple[str, int]]:
    """Kind and second key pose of the steps that tell nothing."""
    factors = _chain(6)
    after = without_lost_steps(factors, breaks)
    changed = [now for was, now in zip(factors, after, strict=True) if now is not was]
    assert all(np.allclose(factor.covariance, UNKNOWN_STEP) for factor in changed)
    return [(factor.kind, factor.j) for factor in changed]


def _break(key: int, outcome: Outcome = Outcome.APART, *, agreeing: int = 0, is_sudden: bool = True) -> Break:
    return Break(key=key, outcome=outcome, reason="", closures=agreeing, scan=10 * key if is_sudden else None)


def test_a_robot_that_sees_something_else_at_once_may_be_anywhere() -> None:
    assert _torn(_break(3)) == [("odometry", 3)]


def test_a_match_to_what_was_before_tells_nothing_then_either() -> None:
    assert _torn(_break(1)) == [("odometry", 1), ("ice", 1)]


def test_one_that_sees_no_more_change_than_usual_goes_on_as_odometry_says() -> None:
    assert _torn(_break(3, is_sudden=False)) == []


def test_nor_does_a_match_to_what_was_before_of_a_later_key_pose() -> None:
    assert _torn(_break(1)) == _torn(_break(1)) != []
    factors = [*_chain(6), Factor(kind="ice", i=1, j=4, T_i_j=_STEP, covariance=1e-4 * np.eye(3))]
    after = without_lost_steps(factors, [_break(3)])
    told = [(factor.kind, factor.i, factor.j) for factor, now in zip(factors, after, strict=True) if now is not factor]
    assert told == [("odometry", 2, 3), ("ice", 1, 4)]


@pytest.mark.parametrize("outcome", [Outcome.JOINED, Outcome.DRIFTED])
def test_only_parts_that_nothing_joins(outcome: Outcome) -> None:
    assert _torn(_break(2, outcome)) == []


@pytest.mark.parametrize("log_odds", [-800.0, -2.0, 0.0, 3.0, 800.0])
def test_odds_either_way_make_probabilities_that_add_up(log_odds: float) -> None:
    assert probability(log_odds) + probability(-log_odds) == pytest.approx(1.0)
    failure = TrackingFailure(kind=FailureKind.NO_MATCH, reason="", log_odds_carried=log_odds)
    assert failure.probability_carried == probability(log_odds)
    assert np.log(probability(2.0) / probability(-2.0)) == pytest.approx(2.0)


def test_where_the_view_is_unknown_a_failure_is_no_doubt_but_scans_elsewhere_may_make_it_one() -> None:
    failure, views = TrackingFailure(kind=FailureKind.NO_MATCH, reason=""), LoopClosureConfig().view
    assert failure.probability_carried == 0.0
    assert failure.log_odds(views) == pytest.approx(np.log(views.carried_prior))
