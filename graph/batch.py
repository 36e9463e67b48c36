"""All factors at once: Levenberg-Marquardt on the whole graph, from records and first guesses."""

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

import gtsam
import numpy as np
from numpy.typing import NDArray

from graph.errors import GraphError
from graph.factors import Factor
from graph.gtsam_bridge import from_gtsam_values, marginal_covariances_of, to_gtsam_graph, to_gtsam_values
from graph.se2 import compose, inverse

_LINEAR_SOLVERS = ("MULTIFRONTAL_CHOLESKY", "MULTIFRONTAL_QR")


@dataclass(frozen=True, kw_only=True)
class BatchConfig:
    """When to stop.

    Attributes:
        max_iterations: at most so many steps.
        relative_tolerance: stop when |change of error| / error falls below it.
        absolute_tolerance: stop when |change of error| falls below it (error = half the sum of squared, whitened
            residuals).
    """

    max_iterations: int = 100
    relative_tolerance: float = 1e-9
    absolute_tolerance: float = 1e-9

    def __post_init__(self) -> None:
        if self.max_iterations < 1:
            raise GraphError(f"max_iterations is at least 1, found {self.max_iterations}")
        if not (self.relative_tolerance >= 0.0 and self.absolute_tolerance >= 0.0):
            raise GraphError(
                f"tolerances are not negative, found {self.relative_tolerance} and {self.absolute_tolerance}"
            )


@dataclass(frozen=True, kw_only=True)
class BatchResult:
    """An optimised graph.

    Attributes:
        poses: (n, 3) T_map_robot of the key poses.
        error_before: half the sum of squared, whitened (and robustly weighted) residuals at the first guess.
        error_after: the same at `poses`.
        iterations: steps taken.
    """

    poses: NDArray[np.float64]
    error_before: float
    error_after: float
    iterations: int


def optimize(factors: Sequence[Factor], initial: NDArray[np.float64], config: BatchConfig | None = None) -> BatchResult:
    """The most likely poses given all factors, by Levenberg-Marquardt.

    Args:
        factors: at least one prior among them.
        initial: (n, 3) first guesses of T_map_robot.
        config: when to stop.

    Returns:
        The optimum that the first guess leads to.

    Raises:
        GraphError: a factor joins a pose that is not there, a pose hangs on nothing, or no linear solver copes.
    """
    stop = config or BatchConfig()
    check_determined(factors, len(initial))
    graph, values = to_gtsam_graph(factors), to_gtsam_values(initial)
    failures = []
    for solver in _LINEAR_SOLVERS:
        params = gtsam.LevenbergMarquardtParams()
        params.setLinearSolverType(solver)
        params.setMaxIterations(stop.max_iterations)
        params.setRelativeErrorTol(stop.relative_tolerance)
        params.setAbsoluteErrorTol(stop.absolute_tolerance)
        try:
            optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, params)
            optimum = optimizer.optimize()
        except RuntimeError as err:
            failures.append(f"{solver}: {' '.join(str(err).split())}")
            continue
        return BatchResult(
            poses=from_gtsam_values(optimum),
            error_before=graph.error(values),
            error_after=graph.error(optimum),
            iterations=optimizer.iterations(),
        )
    raise GraphError(f"{len(factors)} factors on {len(initial)} poses cannot be optimised; {'; '.join(failures)}")


def graph_error(factors: Sequence[Factor], poses: NDArray[np.float64]) -> float:
    """Half the sum of squared, whitened (and robustly weighted) residuals of the factors at (n, 3) poses."""
    return float(to_gtsam_graph(factors).error(to_gtsam_values(poses)))


def marginal_covariances(factors: Sequence[Factor], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """How well each pose is known.

    Args:
        factors: at least one prior among them.
        poses: (n, 3) optimised T_map_robot.

    Returns:
        (n, 3, 3) marginal covariances, each in the tangent space at its pose.

    Raises:
        GraphError: the factors do not determine every pose.
    """
    check_determined(factors, len(poses))
    try:
        return marginal_covariances_of(to_gtsam_graph(factors), to_gtsam_values(poses))
    except RuntimeError as err:
        raise GraphError(f"no covariances: {' '.join(str(err).split())}") from err


def check_determined(factors: Sequence[Factor], n_poses: int) -> None:
    """Every pose hangs, over factors, on a prior.

    Raises:
        GraphError: a factor joins a pose that is not there, or a pose hangs on nothing.
    """
    neighbours = _factors_at(factors, n_poses)
    open_ends = [factor.j for factor in factors if factor.i is None]
    if not open_ends:
        raise GraphError(f"none of the {len(factors)} factors is a prior: nothing ties the poses to the map")
    hanging = [False] * n_poses
    while open_ends:
        here = open_ends.pop()
        if not hanging[here]:
            hanging[here] = True
            open_ends.extend(_other_end(factor, here) for factor in neighbours[here])
    if not all(hanging):
        raise GraphError(
            f"{hanging.count(False)} of {n_poses} poses hang on no prior, the first is pose {hanging.index(False)}"
        )


def chained_poses(factors: Sequence[Factor], n_poses: int) -> NDArray[np.float64]:
    """First guesses from the factors alone: measurements chained from the priors outwards.

    The chain is the minimum spanning tree in which a factor costs the distance between its pose numbers, then its
    covariance: odometry and matches along the way go before loop closures, which may be false.

    Args:
        factors: at least one prior among them.
        n_poses: number of key poses.

    Returns:
        (n_poses, 3) T_map_robot.

    Raises:
        GraphError: a pose hangs on no prior.
    """
    check_determined(factors, n_poses)
    neighbours = _factors_at(factors, n_poses)
    order = {id(factor): index for index, factor in enumerate(factors)}
    poses = np.full((n_poses, 3), np.nan)
    queue = [(0, 0.0, order[id(factor)], factor.j) for factor in factors if factor.i is None]
    while queue:
        _, _, index, here = heappop(queue)
        if not np.isnan(poses[here, 0]):
            continue
        poses[here] = _placed(factors[index], here, poses)
        for factor in neighbours[here]:
            other = _other_end(factor, here)
            if np.isnan(poses[other, 0]):
                cost = (abs(other - here), float(np.trace(factor.covariance)), order[id(factor)])
                heappush(queue, (*cost, other))
    return poses


def _placed(factor: Factor, here: int, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """T_map_here from the pose at the factor's other end."""
    if factor.i is None:
        return factor.T_i_j
    if factor.j == here:
        return compose(poses[factor.i], factor.T_i_j)
    return compose(poses[factor.j], inverse(factor.T_i_j))


def _other_end(factor: Factor, here: int) -> int:
    return factor.j if factor.i is None or factor.i == here else factor.i


def _factors_at(factors: Sequence[Factor], n_poses: int) -> list[list[Factor]]:
    """For each pose the factors that join it to others."""
    at: list[list[Factor]] = [[] for _ in range(n_poses)]
    for factor in factors:
        if not (0 <= factor.j < n_poses and (factor.i is None or 0 <= factor.i < n_poses)):
            raise GraphError(f"{factor} joins a pose that is not among the {n_poses} there are")
        if factor.i is not None:
            at[factor.i].append(factor)
            at[factor.j].append(factor)
    return at
