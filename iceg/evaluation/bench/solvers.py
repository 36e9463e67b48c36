"""The solvers of `graph` beside GTSAM's on the final graphs of logs: why there is a second one at all."""

import time
from collections.abc import Callable
from dataclasses import replace

import gtsam
import numpy as np
from numpy.typing import NDArray

from frontends.logs import read_log
from graph.batch import BatchConfig, marginal_covariances, optimize
from graph.factors import Factor, RobustKernel
from graph.gtsam_bridge import from_gtsam_values, to_gtsam_graph, to_gtsam_values
from graph.se2 import compose
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.bench.tables import Row
from iceg.pipeline import run

_OFF = np.array([0.05, 0.05, 0.01])
"""Standard deviations of the start [m, m, rad]."""
_REPEATS = 3
_KERNEL = RobustKernel(name="dcs", width=5.0)


def solver_rows(log: BenchLog) -> list[Row]:
    """Time and result of each task by either solver, from a start some centimetres off.

    Args:
        log: which is run first.

    Returns:
        A row a task: the least of three times each [s], their ratio, and the largest distance of a pose, or the largest
        ratio of standard deviations less one, between the two.
    """
    result = run(read_log(log.path))
    factors = [replace(f, kernel=_KERNEL) if f.kind == "closure" else f for f in result.graph.factors]
    plain = [replace(f, kernel=None) for f in factors]
    poses = optimize(plain, result.key_poses).poses
    start = compose(poses, np.random.default_rng(0).normal(0.0, _OFF, poses.shape))
    size: Row = {"log": log.name, "poses": len(poses), "factors": len(factors)}
    least_squares = _row(lambda: optimize(plain, start).poses, lambda: _by_gtsam(plain, start), _farthest)
    robust = _row(lambda: optimize(factors, start).poses, lambda: _by_gtsam(factors, start), _farthest)
    gnc = _row(lambda: optimize(plain, start, BatchConfig(gnc=True)).poses, lambda: _gnc(plain, start), _farthest)
    known = _row(lambda: marginal_covariances(plain, poses), lambda: _marginals(plain, poses), _widest)
    tasks = (("least squares", least_squares), ("DCS", robust), ("GNC", gnc), ("all marginals", known))
    return [{**size, "task": task, **row} for task, row in tasks]


Solve = Callable[[], NDArray[np.float64]]


def _row(ours: Solve, theirs: Solve, apart: Callable[[NDArray[np.float64], NDArray[np.float64]], float]) -> Row:
    (found, seconds), (expected, gtsam_seconds) = _timed(ours), _timed(theirs)
    return {
        "graph.batch [s]": seconds,
        "GTSAM [s]": gtsam_seconds,
        "ratio": gtsam_seconds / seconds,
        "apart [mm, ‰]": 1000.0 * apart(found, expected),
    }


def _timed(solve: Solve) -> tuple[NDArray[np.float64], float]:
    times = []
    for _ in range(_REPEATS):
        started = time.process_time()
        found = solve()
        times.append(time.process_time() - started)
    return found, min(times)


def _by_gtsam(factors: list[Factor], start: NDArray[np.float64]) -> NDArray[np.float64]:
    return from_gtsam_values(
        gtsam.LevenbergMarquardtOptimizer(to_gtsam_graph(factors), to_gtsam_values(start)).optimize()
    )


def _gnc(factors: list[Factor], start: NDArray[np.float64]) -> NDArray[np.float64]:
    params = gtsam.GncLMParams()
    params.setKnownInliers([index for index, factor in enumerate(factors) if factor.kind != "closure"])
    optimizer = gtsam.GncLMOptimizer(to_gtsam_graph(factors), to_gtsam_values(start), params)
    return from_gtsam_values(optimizer.optimize())


def _marginals(factors: list[Factor], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    marginals = gtsam.Marginals(to_gtsam_graph(factors), to_gtsam_values(poses))
    return np.array([marginals.marginalCovariance(key) for key in range(len(poses))])


def _farthest(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> float:
    """[m]."""
    return float(np.hypot(*(ours - theirs)[:, :2].T).max())


def _widest(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> float:
    variances = [np.diagonal(each, axis1=1, axis2=2)[1:] for each in (ours, theirs)]
    return float(np.abs(np.sqrt(variances[0] / variances[1]) - 1.0).max())
