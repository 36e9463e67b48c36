"""The NEES study: right covariances pass, wrong ones do not, correlation inside a run changes nothing."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.factors import Factor
from graph.se2 import between, compose, expmap
from iceg.cli import main
from iceg.demo import demo_log_path
from iceg.evaluation.bench.consistency import factor_consistency
from iceg.evaluation.nees_study import (
    FIRST_SEED,
    POSES,
    JudgedRun,
    factor_nees,
    judge_run,
    mean_bounds,
    simulated,
    summarise,
)

Array = NDArray[np.float64]

COVARIANCE = np.array([[4e-4, 1e-4, 0.0], [1e-4, 1e-4, 2e-5], [0.0, 2e-5, 1e-4]])


def measured(truth: Array, scale: float, seed: int) -> list[Factor]:
    """Steps with errors whose standard deviations are `scale` times what their covariance says."""
    errors = np.random.default_rng(seed).multivariate_normal(np.zeros(3), COVARIANCE, len(truth) - 1)
    steps = compose(between(truth[:-1], truth[1:]), expmap(scale * errors))
    return [Factor(kind="odometry", i=k, j=k + 1, T_i_j=step, covariance=COVARIANCE) for k, step in enumerate(steps)]


def judged(values: Array, seed: int = 0, scene: str = "here") -> JudgedRun:
    return JudgedRun(scene=scene, seed=seed, values={"odometry": values}, without_truth={}, faded=0)


@pytest.mark.parametrize(("scale", "within"), [(1.0, "yes"), (1.25, "no"), (0.8, "no")])
def test_right_covariances_pass_and_others_do_not(scale: float, within: str) -> None:
    truth = np.random.default_rng(0).uniform(-3, 3, (100, 3))
    runs = [judged(factor_nees(measured(truth, scale, seed), truth), seed) for seed in range(50)]
    (row,) = summarise(runs)
    assert row["mean"] == pytest.approx(3 * scale**2, rel=0.05)
    assert row["within"] == within


def test_values_that_err_together_are_not_taken_for_many() -> None:
    # Each run repeats one value throughout: the interval must still hold its 95 %, the standard error must be honest.
    rng = np.random.default_rng(1)
    rows = [
        summarise([judged(np.full(200, value), seed) for seed, value in enumerate(rng.chisquare(3, 20))])[0]
        for _ in range(300)
    ]
    assert 0.92 < np.mean([row["within"] == "yes" for row in rows]) < 0.98
    claimed = np.mean([float(row["standard error"] or 0) ** 2 for row in rows])
    assert claimed == pytest.approx(np.var([float(row["mean"] or 0) for row in rows]), rel=0.25)


def test_every_run_counts_once_and_scenes_are_told_apart() -> None:
    runs = [judged(np.full(10, 1.0), 0, "a"), judged(np.full(1000, 5.0), 1, "a"), judged(np.full(3, 6.0), 0, "b")]
    a, b, both = summarise(runs)
    assert (a["scene"], a["mean"], a["runs"], a["values"]) == ("a", 3.0, 2, 1010)
    assert (b["scene"], b["mean"], b["standard error"]) == ("b", 6.0, None)
    assert (both["scene"], both["mean"]) == ("all", 4.0)


def test_bounds_are_those_of_the_literature() -> None:
    # Bar-Shalom, Li, Kirubarajan 2001, example 5.4: fifty runs; here of three degrees of freedom: χ²(150)/50.
    assert mean_bounds(50) == pytest.approx((2.3597, 3.7160), abs=1e-3)


def test_a_simulated_run_is_judged_in_every_respect() -> None:
    (recording,) = simulated(["room"], 1)
    found = judge_run(recording)
    assert set(found.values) == {"odometry", "ice", "closure", POSES}
    assert len(found.values[POSES]) == len(found.values["odometry"]) > 50
    assert 0.3 < found.values["ice"].mean() < 8.0
    assert found.without_truth["ice"].mean() < found.values["ice"].mean()


def test_in_a_corridor_the_long_direction_is_weak_and_the_others_are_right() -> None:
    row = factor_consistency("long_corridor", range(FIRST_SEED, FIRST_SEED + 1))
    assert float(row["weak matches [%]"] or 0) > 50.0
    assert float(row["NEES mean"] or 0) < 3.0 * float(row["NEES per observed direction"] or 0)
    assert 0.3 < float(row["NEES per observed direction"] or 0) < 1.8


def test_a_robot_that_starts_from_rest_where_no_scan_sees_it_is_not_believed_to_have_driven_on() -> None:
    """The velocity takes odometry's place there; its first step made all key poses far too sure."""
    runs = [judge_run(recording).values[POSES].mean() for recording in simulated(["long_corridor"], 3)]
    assert np.mean(runs) < 6.0


def test_runs_are_spread_over_the_scenes() -> None:
    assert [(one.scene, one.seed) for one in simulated(["room", "vanishing_wall"], 3)] == [
        ("room", FIRST_SEED),
        ("room", FIRST_SEED + 1),
        ("vanishing_wall", FIRST_SEED),
    ]


def test_the_command_prints_and_keeps_its_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["nees", "--runs", "1", "--scenes", "room", "-o", str(tmp_path)]) == 0
    assert "| key poses | room" in capsys.readouterr().out
    with (tmp_path / "nees.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["NEES of"] for row in rows] == ["odometry", "ice", "closure", "key poses"]
    assert (tmp_path / "nees.png").stat().st_size > 5000
    assert (tmp_path / "nees-runs.csv").read_text(encoding="utf-8").splitlines()[1].startswith(f"room,{FIRST_SEED},")


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--runs", "0"], 2, "expected at least 1"),
        (["nowhere.clf"], 1, "nowhere.clf: cannot be read"),
        (["LOG"], 1, "found no office.truth.csv beside it"),
        (["nowhere.clf", "--scenes", "room"], 2, "expected one of them"),
    ],
)
def test_misuse_is_named(
    words: list[str], code: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = shutil.copy(demo_log_path(), tmp_path)
    assert main(["nees", *[word.replace("LOG", str(log)) for word in words], "-o", str(tmp_path / "out")]) == code
    assert said in " ".join(capsys.readouterr().err.split())
