"""The truth is as probable under factors as the normal distribution says, and tables of it are compared by scene."""

from pathlib import Path

import numpy as np
import pytest

from graph.factors import Factor
from graph.se2 import between, compose, expmap
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.likelihood import (
    FARTHEST,
    KINDS,
    JudgeFactors,
    Likelihood,
    compared,
    log_densities,
    main,
    read_likelihoods,
)

_SIGMAS = np.array([0.1, 0.2, 0.05])
_TRUTH = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.3], [2.0, 0.0, -1.0]])


def _factor(error: np.ndarray) -> Factor:
    measured = compose(between(_TRUTH[1], _TRUTH[2]), expmap(-error))
    return Factor(kind="ice", i=1, j=2, T_i_j=measured, covariance=np.diag(_SIGMAS**2))


def test_the_density_is_that_of_the_normal_distribution() -> None:
    errors = np.random.default_rng(1).normal(size=(20, 3)) * _SIGMAS
    expected = (-0.5 * (errors / _SIGMAS) ** 2 - np.log(_SIGMAS) - 0.5 * np.log(2.0 * np.pi)).sum(axis=1)
    np.testing.assert_allclose(log_densities([_factor(error) for error in errors], _TRUTH), expected, rtol=1e-5)


def test_how_wrong_a_wrong_factor_is_does_not_count() -> None:
    wrong, worse = log_densities([_factor(np.array([far, 0.0, 0.0])) for far in (2.0, 50.0)], _TRUTH)
    assert wrong == worse
    right = log_densities([_factor(np.zeros(3))], _TRUTH)[0]
    assert right - wrong == pytest.approx(FARTHEST / 2.0)


def test_no_factors_have_no_density() -> None:
    assert len(log_densities([], _TRUTH)) == 0


def test_scenes_of_both_tables_are_compared() -> None:
    before = [Likelihood(scene=f"random:{k}", of_kinds=(1.0, 2.0, None)) for k in range(8)]
    after = [Likelihood(scene=f"random:{k}", of_kinds=(1.5, 2.0, 3.0)) for k in range(2, 12)]
    odometry, ice, closure = compared(before, after)
    assert [odometry[name] for name in ("factors", "scenes", "gain [nats]", "better", "worse")] == [
        "odometry",
        6,
        0.5,
        6,
        0,
    ]
    assert odometry["p"] == pytest.approx(2.0 / 2**6)
    assert (ice["gain [nats]"], ice["p"]) == (0.0, 1.0)
    assert (closure["scenes"], closure["gain [nats]"]) == (0, None)
    with pytest.raises(EvaluationError, match="no scene in common"):
        compared(before[:2], after)


def test_a_table_is_written_and_compared_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, again = tmp_path / "first.csv", tmp_path / "again.csv"
    JudgeFactors(output=first, seeds="26014", workers=1)()
    (found,) = read_likelihoods(first)
    assert found.scene == "random:26014"
    JudgeFactors(output=again, seeds="26014", workers=1, baseline=first)()
    assert first.read_bytes() == again.read_bytes()
    told = capsys.readouterr().out
    assert all(kind in told for kind in KINDS)


@pytest.mark.parametrize(
    ("content", "where"),
    [
        ("scene,odometry\n", r"table\.csv: found the columns"),
        ("scene,odometry,ice,closure\nrandom:1,1.0,,\nrandom:2,x,,\n", r"table\.csv:3: expected a number"),
        ("scene,odometry,ice,closure\nrandom:1,1.0\n", r"table\.csv:2: expected a number"),
    ],
)
def test_another_table_is_refused(tmp_path: Path, content: str, where: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(content)
    with pytest.raises(EvaluationError, match=where):
        read_likelihoods(path)
    with pytest.raises(EvaluationError, match="missing"):
        read_likelihoods(tmp_path / "missing.csv")


@pytest.mark.parametrize(
    ("asked", "expected"),
    [(["--seeds", "x"], "found seeds 'x'"), (["--seeds", "1", "--workers", "0"], "found 0 workers")],
)
def test_what_cannot_be_run_is_told_in_one_line(
    asked: list[str], expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["likelihood", "-o", str(tmp_path / "table.csv"), *asked])
    with pytest.raises(SystemExit, match=f"likelihood: {expected}"):
        main()
