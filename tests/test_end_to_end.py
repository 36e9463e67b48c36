"""Whole runs held to bounds loose enough never to flake: public logs by their relations and truth, the embedded log."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import iceg
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.consistency import pose_nees
from iceg.evaluation.relations import error_statistics, read_relations_csv, relation_errors
from iceg.evaluation.trajectory import read_reference_csv, read_truth_csv, trajectory_errors
from iceg.maps.config import GridConfig
from iceg.run_result.slam_result import SlamResult
from iceg.slam.config import LoopClosureConfig

LOOPS_OPEN = LoopClosureConfig(enabled=False)
COARSE = GridConfig(resolution=0.5)


@cache
def run(path: Path, closing_loops: bool) -> SlamResult:
    """One run for all tests that look at it."""
    loops = LoopClosureConfig() if closing_loops else LOOPS_OPEN
    return iceg.run(iceg.read_log(path), iceg.Config(loops=loops, grid=COARSE))


def relations_mean(data_dir: Path, name: str, closing_loops: bool) -> float:
    result = run(data_dir / f"{name}.clf.gz", closing_loops)
    errors = relation_errors(result.trajectory, read_relations_csv(data_dir / f"{name}.relations.csv"))
    return error_statistics(errors.translation).mean


@pytest.mark.parametrize(
    ("name", "closing_loops", "bound"),
    [("intel", True, 0.02), ("mit-csail", False, 0.15), ("mit-csail", True, 0.035)],
)
def test_relations_of_the_benchmark(data_dir: Path, name: str, closing_loops: bool, bound: float) -> None:
    assert relations_mean(data_dir, name, closing_loops) <= bound


def test_simulated_corridors_of_a_public_log(data_dir: Path) -> None:
    result = run(data_dir / "mrpt-simul.clf.gz", True)
    assert trajectory_errors(result.trajectory, read_truth_csv(data_dir / "mrpt-simul.truth.csv")).ate_rmse <= 0.08


def test_a_building_of_long_corridors(data_dir: Path) -> None:
    result = run(data_dir / "aces.clf.gz", True)
    scans, reference = read_reference_csv(data_dir / "aces.reference.csv")
    assert trajectory_errors(result.trajectory[scans], reference).ate_rmse <= 0.3


@pytest.mark.parametrize("closing_loops", [False, True])
def test_the_embedded_log_against_its_truth(closing_loops: bool) -> None:
    result = run(demo_log_path(), closing_loops)
    truth = read_truth_csv(demo_truth_path())
    assert trajectory_errors(result.trajectory, truth).ate_rmse <= 0.05
    values = pose_nees(result.key_poses, truth[result.key_scans], result.covariances)
    assert np.mean(values < 16.3) > 0.9, "16.3 is the 99.9 % quantile"
    assert result.summary["scans_carried_by_odometry"] == 0


def test_every_factor_counts_once() -> None:
    result = run(demo_log_path(), True)
    factors = result.graph.factors
    neighbours = [(key, key + 1) for key in range(len(result.key_poses) - 1)]
    for kind in ("odometry", "ice"):
        assert [(factor.i, factor.j) for factor in factors if factor.kind == kind] == neighbours
    assert sum(result.summary["factors"].values()) == len(factors)
