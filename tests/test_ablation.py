"""What is ablated is really ablated; false closures among a real run's factors; the tables on a short log."""

import csv
import gzip
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import iceg
from graph.batch import BatchConfig, optimize
from graph.factors import Factor
from graph.se2 import between, compose, expmap
from iceg.cli import main
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.ablation import (
    ablation,
    calibrated_odometry,
    logs_to_judge,
    moved_with_key_poses,
    with_covariances,
)
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.relations import read_relations_csv, relation_errors
from iceg.evaluation.trajectory import read_truth_csv, trajectory_errors
from iceg.maps.config import GridConfig
from iceg.run_result.slam_result import SlamResult

Array = NDArray[np.float64]

N_SCANS = 150
COARSE = iceg.Config(grid=GridConfig(resolution=0.5))


@pytest.fixture(scope="module")
def short_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first metres of the embedded log, its truth beside it."""
    folder = tmp_path_factory.mktemp("log")
    with gzip.open(demo_log_path(), "rt", encoding="ascii") as lines:
        scans = (line for line in lines if line.startswith("FLASER"))
        (folder / "short.clf").write_text("".join(itertools.islice(scans, N_SCANS)), encoding="ascii")
    truth = demo_truth_path().read_text(encoding="utf-8").splitlines()[: N_SCANS + 1]
    (folder / "short.truth.csv").write_text("\n".join(truth) + "\n", encoding="utf-8")
    return folder / "short.clf"


@pytest.fixture(scope="module")
def office() -> SlamResult:
    return iceg.run(iceg.read_log(demo_log_path()), COARSE)


def test_tables_of_a_log(short_log: Path) -> None:
    (log,) = logs_to_judge([short_log], None)
    tables = ablation(log)
    assert [row["stage"] for row in tables.stages] == [
        "odometry",
        "calibrated odometry",
        "front end",
        "+ loops",
        "+ finish",
        "+ joint refinement",
    ]
    assert [row["covariances"] for row in tables.covariances] == ["calibrated", "constant", "identity"]
    ate = {row["stage"]: row["ATE [m]"] for row in tables.stages}
    assert isinstance(ate["odometry"], float)
    assert isinstance(ate["+ joint refinement"], float)
    assert ate["+ joint refinement"] < 0.5 * ate["odometry"]
    # Solving the finished graph again with its own covariances leads to where it was before the joint refinement.
    calibrated = tables.covariances[0]["ATE [m]"]
    assert calibrated == pytest.approx(ate["+ finish"], abs=2e-3)


def test_from_the_command_line(short_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ablation", str(short_log), "-o", str(tmp_path / "tables")]) == 0
    shown = capsys.readouterr().out
    with (tmp_path / "tables" / "ablation-covariances.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["log"] for row in rows] == ["short"] * 3
    for row in rows:
        assert f"{float(row['ATE [m]']):.4f}" in shown
    assert len((tmp_path / "tables" / "ablation-stages.csv").read_text(encoding="utf-8").splitlines()) == 7


def test_a_log_with_nothing_to_judge_it_by(tmp_path: Path) -> None:
    log = tmp_path / "bare.clf.gz"
    with pytest.raises(EvaluationError, match=r"bare\.clf\.gz: found no such file"):
        logs_to_judge([log], None)
    log.touch()
    with pytest.raises(EvaluationError, match=r"bare\.relations\.csv, bare\.truth\.csv, bare\.reference\.csv"):
        logs_to_judge([log], None)
    with pytest.raises(EvaluationError, match="nothing is known"):
        ablation(BenchLog(name="bare", path=demo_log_path(), known=None))


def test_a_folder_of_logs_that_is_none_is_no_empty_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, code, said in (
        (["--data", str(tmp_path / "nowhere")], 1, "nowhere: is no folder"),
        ([str(demo_log_path()), "--data", str(tmp_path)], 2, "found logs and --data"),
    ):
        assert main(["ablation", *words, "-o", str(tmp_path / "out")]) == code
        assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_other_covariances_the_same_measurements(office: SlamResult) -> None:
    factors = office.graph.factors
    assert with_covariances(factors, "calibrated") == list(factors)
    constant, identity = with_covariances(factors, "constant"), with_covariances(factors, "identity")
    for given, same, unit in zip(factors, constant, identity, strict=True):
        assert (given.kind, given.i, given.j, given.kernel) == (same.kind, same.i, same.j, same.kernel)
        np.testing.assert_array_equal(given.T_i_j, unit.T_i_j)
        if given.kind == "prior":
            np.testing.assert_array_equal(given.covariance, unit.covariance)
        else:
            np.testing.assert_array_equal(unit.covariance, np.eye(3))
    of_matches = {factor.covariance.tobytes() for factor in constant if factor.kind == "ice"}
    assert len(of_matches) == 1
    variances = [np.diag(factor.covariance) for factor in factors if factor.kind == "ice"]
    median = next(factor.covariance for factor in constant if factor.kind == "ice")
    np.testing.assert_allclose(np.diag(median), np.median(variances, axis=0))


def test_the_trajectory_goes_with_its_key_poses(office: SlamResult) -> None:
    np.testing.assert_allclose(moved_with_key_poses(office, office.key_poses), office.trajectory, atol=1e-9)
    T_other_map = np.array([3.0, -2.0, 0.7])
    moved = moved_with_key_poses(office, compose(T_other_map, office.key_poses))
    difference = between(compose(T_other_map, office.trajectory), moved)
    np.testing.assert_allclose(difference, 0.0, atol=1e-9)


def test_calibrated_odometry_is_nearer_to_the_truth(office: SlamResult) -> None:
    truth = read_truth_csv(demo_truth_path())
    raw, calibrated = (trajectory_errors(T, truth).ate_rmse for T in (office.log.odometry, calibrated_odometry(office)))
    assert calibrated < raw


def false_closures(factors: list[Factor], poses: Array, share: float, seed: int) -> list[Factor]:
    """So many more closures, each between two places apart, each as sure of itself as a true one.

    Half of them come in pairs that agree with each other, as those of a corridor that looks like another do.
    """
    rng = np.random.default_rng(seed)
    true = [factor for factor in factors if factor.kind == "closure"]
    found: list[Factor] = []
    while len(found) < round(share * len(true)):
        like = true[int(rng.integers(len(true)))]
        i, j = sorted(rng.integers(0, len(poses) - 1, 2).tolist())
        claimed = compose(like.T_i_j, expmap(rng.normal(0.0, [0.5, 0.5, 0.3])))
        off = between(claimed, between(poses[i], poses[j]))
        if j - i < 10 or np.hypot(off[0], off[1]) < 1.0:
            continue
        wrong = replace(like, i=i, j=j, T_i_j=claimed)
        found.append(wrong)
        if len(found) % 4 == 1:
            next_to_it = compose(compose(between(poses[i + 1], poses[i]), claimed), between(poses[j], poses[j + 1]))
            found.append(replace(wrong, i=i + 1, j=j + 1, T_i_j=next_to_it))
    return found


def test_false_closures_in_the_embedded_log_change_nothing(office: SlamResult) -> None:
    truth = read_truth_csv(demo_truth_path())
    factors = list(office.graph.factors)

    def error(wrong: list[Factor]) -> float:
        solved = optimize([*factors, *wrong], office.key_poses, BatchConfig(gnc=True))
        assert not solved.inliers[len(factors) :].any()
        return trajectory_errors(moved_with_key_poses(office, solved.poses), truth).ate_rmse

    clean = error([])
    for share in (0.1, 0.2, 0.5):
        assert error(false_closures(factors, office.key_poses, share, seed=3)) < 1.1 * clean
    wrong = false_closures(factors, office.key_poses, 0.2, seed=3)
    plain = optimize([*factors, *wrong], office.key_poses, BatchConfig(kernel="none"))
    undefended = trajectory_errors(moved_with_key_poses(office, plain.poses), truth).ate_rmse
    assert undefended > 5.0 * clean, "the defence is needed"


def test_false_closures_in_intel_change_nothing(data_dir: Path) -> None:
    # From the odometry on: chained matches, no help from the clean solution.
    result = iceg.run(iceg.read_log(data_dir / "intel.clf.gz"), COARSE)
    relations = read_relations_csv(data_dir / "intel.relations.csv")
    factors = list(result.graph.factors)

    def error(wrong: list[Factor]) -> float:
        solved = optimize([*factors, *wrong], None, BatchConfig(gnc=True))
        return float(relation_errors(moved_with_key_poses(result, solved.poses), relations).translation.mean())

    clean = error([])
    assert clean < 0.02
    assert error(false_closures(factors, result.key_poses, 0.5, seed=3)) < 1.1 * clean
