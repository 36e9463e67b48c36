"""The recordings behind the cells, with all that is known about them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from frontends.simulator.lasers import LASERS as NAMED_LASERS
from frontends.simulator.random_scenes.scene import named_seed, simulate_random
from frontends.simulator.robot import Driving
from frontends.simulator.simulation import simulate
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.cells import LOGS, Cell
from iceg.evaluation.regression.lasers import LASERS
from iceg.evaluation.relations import read_relations_csv, relation_errors
from iceg.evaluation.trajectory import (
    check_one_row_per_scan,
    poses_of_scans,
    read_reference_csv,
    read_truth_csv,
    trajectory_errors,
)

Judge = Callable[[NDArray[np.float64]], float]
"""Error [m] of (n_scans, 3) poses."""

_NOISE_M = 0.001
_BRISK = Driving(speed=1.2)
_LARGE = frozenset({"alike", "campus", "mall", "park", "pillars", "ring"})
"""Scenes that are driven through at twice the usual speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A log and what it is judged by.

    Attributes:
        log: as it was recorded.
        truth: (n_scans, 3) exact poses; None where there are only relations, or a reference.
        judge: error of a trajectory of the whole log [m]: mean of the relations, else absolute trajectory error.
    """

    log: Log
    truth: NDArray[np.float64] | None
    judge: Judge

    @property
    def odometry_error(self) -> float:
        """Error of the odometry as it was recorded [m]; in a log without, of a robot that stands still."""
        return self.judge(self.log.odometry)


def recording_of(cell: Cell, data: Path | None) -> Recording:
    """Read or simulate what a cell is made from.

    Args:
        cell: any of the table.
        data: folder of the public logs.

    Raises:
        IcegError: it is not there, or cannot be read.
    """
    if cell.is_simulated:
        return _simulation(cell.source)
    if cell.source == "office":
        return _of(BenchLog(name="office", path=demo_log_path(), known=demo_truth_path()))
    if data is None:
        raise EvaluationError(f"found no folder of public logs, expected one with {cell.source}")
    folder = data if cell.source in LOGS else data / "worlds"
    return _of(BenchLog.at(folder / f"{cell.source}.clf.gz"))


def with_noise(log: Log, seed: int) -> Log:
    """The same with a millimetre of noise on the ranges; seed 0 leaves it as it is."""
    if seed == 0:
        return log
    noise = np.random.default_rng(seed).normal(0.0, _NOISE_M, log.ranges.shape)
    return replace(log, ranges=np.maximum(log.ranges + noise, log.geometry.range_min).astype(np.float32))


@cache
def _simulation(source: str) -> Recording:
    drawn, _, other = source.partition(" ")
    seed = named_seed(drawn)
    if seed is None:
        scene, _, laser = source.rpartition(" ")
        driving = _BRISK if scene in _LARGE else None
        simulation = simulate(scene, laser=LASERS[laser], driving=driving)
    else:
        simulation = simulate_random(seed, laser=NAMED_LASERS[other]() if other else None)
    return Recording(log=simulation.log, truth=simulation.truth, judge=_against(simulation.truth))


def _of(log: BenchLog) -> Recording:
    recorded = read_log(log.path)
    if log.known is None:
        raise EvaluationError(
            f"{log.path}: nothing is known about it, expected relations, truth or reference beside it"
        )
    if log.known.name.endswith("truth.csv"):
        truth = read_truth_csv(log.known)
        check_one_row_per_scan(recorded.odometry, truth, log.known)
        return Recording(log=recorded, truth=truth, judge=_against(truth))
    return Recording(log=recorded, truth=None, judge=_without_truth(log.known))


def _without_truth(known: Path) -> Judge:
    if known.name.endswith("relations.csv"):
        relations = read_relations_csv(known)
        return lambda T_map_robot: float(relation_errors(T_map_robot, relations).translation.mean())
    scans, reference = read_reference_csv(known)
    return lambda T_map_robot: trajectory_errors(poses_of_scans(T_map_robot, scans, known), reference).ate_rmse


def _against(truth: NDArray[np.float64]) -> Judge:
    return lambda T_map_robot: trajectory_errors(T_map_robot, truth).ate_rmse
