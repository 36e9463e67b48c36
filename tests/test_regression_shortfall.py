"""Matches that fall short are told from those that err by chance."""

import sys

import numpy as np
import pytest

from frontends.simulator.lasers import LASERS
from graph.factors import Factor
from graph.se2 import between, compose, expmap
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.shortfall import (
    JudgeMatches,
    along_track_errors,
    by_claim,
    main,
    perfect,
    shortfall_of,
)

_SIGMAS = np.array([0.02, 0.01, 0.002])


def _drive(shares: list[float], seed: int = 0) -> tuple[list[Factor], np.ndarray]:
    """Steps of 0.4 m with a turn, each match short by such a share of it, beside its noise."""
    truth = [np.zeros(3)]
    rng, factors = np.random.default_rng(seed), []
    for k, share in enumerate(shares):
        truth.append(compose(truth[-1], np.array([0.4, 0.0, 0.1])))
        off = np.array([share * 0.4, 0.0, 0.0]) + rng.normal(size=3) * _SIGMAS
        measured = compose(between(truth[k], truth[k + 1]), expmap(-off))
        factors.append(Factor(kind="ice", i=k, j=k + 1, T_i_j=measured, covariance=np.diag(_SIGMAS**2)))
    return factors, np.array(truth)


@pytest.mark.parametrize("share", [0.0, 0.02])
def test_what_matches_fall_short_by_is_told(share: float) -> None:
    (row,) = by_claim([along_track_errors(*_drive([share] * 400, seed)) for seed in range(4)])
    assert row["claimed [mm]"] == "10 to 30"
    assert row["matches"] == 1600
    assert row["±"] == pytest.approx(20.0 / 40.0, rel=0.1)
    assert row["short by [mm]"] == pytest.approx(share * 400.0, abs=2.0)
    assert row["share of the way [%]"] == pytest.approx(100.0 * share, abs=0.5)
    assert row["rms of the error / claimed"] == pytest.approx(np.hypot(1.0, share * 20.0), rel=0.05)


def test_wrong_matches_other_factors_and_robots_that_turn_on_the_spot_do_not_count() -> None:
    factors, truth = _drive([0.0, 2.0, 0.0])
    odometry = Factor(kind="odometry", i=0, j=1, T_i_j=factors[0].T_i_j, covariance=np.eye(3))
    stands = np.vstack([truth, compose(truth[-1], np.array([0.0, 0.0, 1.0]))])
    turn = Factor(kind="ice", i=3, j=4, T_i_j=np.array([0.0, 0.0, 1.0]), covariance=np.eye(3))
    assert len(along_track_errors([*factors, odometry, turn], stands).errors) == 2
    assert len(along_track_errors([odometry], truth).errors) == 0
    assert by_claim([along_track_errors(factors, truth)]) == []


def test_a_scene_is_judged() -> None:
    """Beside walls, a laser that does not err has matches that do not either."""
    alongs = shortfall_of(9101, perfect(LASERS["sick"]()))
    assert len(alongs.errors) > 50
    sure = alongs.claimed < 0.01
    assert abs(float(alongs.errors[sure].sum() / alongs.steps[sure].sum())) < 0.005


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (JudgeMatches(seeds="9100", laser="torch"), "found laser 'torch', expected one of"),
        (JudgeMatches(seeds="9100", perfect=True), "needs a laser"),
        (JudgeMatches(seeds="9101", workers=0), "found 0 workers"),
        (JudgeMatches(seeds="walls"), "found seeds 'walls'"),
    ],
)
def test_what_cannot_be_judged_is_an_error(asked: JudgeMatches, said: str) -> None:
    with pytest.raises(EvaluationError, match=said):
        asked()


def test_an_error_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["shortfall", "--seeds", "walls"])
    with pytest.raises(SystemExit, match="shortfall: found seeds 'walls'"):
        main()
