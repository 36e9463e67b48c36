"""All factors at once: the most likely poses, plain or robust against false loop closures."""

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graph.errors import GraphError
from graph.factors import Factor, FactorKind
from graph.gnc import gnc_tls
from graph.noise import largest_squared_norm
from graph.problem import Problem
from graph.se2 import compose, inverse
from graph.start import GrownStart, grown_start

KernelChoice = Literal["given", "none", "huber", "cauchy", "geman_mcclure", "dcs"]


@dataclass(frozen=True, kw_only=True)
class BatchConfig:
    """How a whole graph is solved.

    Attributes:
        kernel: robust kernel of the suspect factors: "given" keeps what each carries, "none" takes it away.
        kernel_width: its width (for "dcs" Φ).
        gnc: decide which suspect factors hold, by graduated non-convexity with truncated least squares from a robust
            optimum (DCS, unless another kernel is chosen).
        inlier_probability: a suspect factor holds within the χ² bound of this probability (3 degrees of freedom).
        suspects: kinds of factors that may be false; the others are known inliers, as is one that alone ties a part of
            the graph to the rest.
        max_iterations: at most so many steps per stage.
        relative_tolerance: stop when |change of error| / error falls below it.
        absolute_tolerance: stop when |change of error| falls below it (error = half the sum of squared, whitened
            residuals).
    """

    kernel: KernelChoice = "given"
    kernel_width: float = 5.0
    gnc: bool = False
    inlier_probability: float = 0.99
    suspects: tuple[FactorKind, ...] = ("closure",)
    max_iterations: int = 100
    relative_tolerance: float = 1e-9
    absolute_tolerance: float = 1e-9

    def __post_init__(self) -> None:
        if self.kernel not in get_args(KernelChoice):
            raise GraphError(f"found the kernel {self.kernel!r}, expected one of {', '.join(get_args(KernelChoice))}")
        if not set(self.suspects) <= set(get_args(FactorKind)):
            raise GraphError(
                f"found the suspects {self.suspects!r}, expected some of {', '.join(get_args(FactorKind))}"
            )
        if not self.kernel_width > 0.0:
            raise GraphError(f"kernel_width is positive, found {self.kernel_width}")
        if not 0.0 < self.inlier_probability < 1.0:
            raise GraphError(f"inlier_probability lies between 0 and 1, found {self.inlier_probability}")
        if self.max_iterations < 1:
            raise GraphError(f"max_iterations is at least 1, found {self.max_iterations}")
        if not (self.relative_tolerance >= 0.0 and self.absolute_tolerance >= 0.0):
            raise GraphError(
                f"tolerances are not negative, found {self.relative_tolerance} and {self.absolute_tolerance}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """One stage of an optimisation: its name, its own error before and after, steps taken."""

    name: str
    error_before: float
    error_after: float
    iterations: int


@dataclass(frozen=True, kw_only=True)
class BatchResult:
    """An optimised graph.

    Attributes:
        poses: (n, 3) T_map_robot of the key poses.
        error_before: error of the first stage at the first guess; error = half the sum of squared, whitened (and
            robustly weighted) residuals.
        error_after: error of the last stage at `poses`.
        iterations: steps taken, all stages.
        weights: (m,) how much each factor pulled in the end, 0 to 1.
        inliers: (m,) which factors hold: decided by the last stage with GNC, else by a weight above ½.
        squared_norms: (m,) squared, whitened residual of each factor at `poses`, without robust weights.
        gate: largest squared norm of a suspect factor that holds.
        stages: what was done.
    """

    poses: NDArray[np.float64]
    error_before: float
    error_after: float
    iterations: int
    weights: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    squared_norms: NDArray[np.float64]
    gate: float
    stages: tuple[Stage, ...]


def optimize(
    factors: Sequence[Factor], initial: NDArray[np.float64] | None, config: BatchConfig | None = None
) -> BatchResult:
    """The most likely poses given all factors.

    Args:
        factors: at least one prior among them.
        initial: (n, 3) first guesses of T_map_robot; None chains the factors and lets closures enter in the order of
            time (`graph.start`), which reaches the right valley from further away and costs some ten times as much.
        config: which stages, and when to stop.

    Returns:
        The optimum, and what every factor had to do with it.

    Raises:
        GraphError: the guesses are no poses, a factor joins a pose that is not there, a pose hangs on nothing, or no
            damping helps.
    """
    settings = config or BatchConfig()
    guesses = None if initial is None else _checked_poses(initial, factors)
    n_poses = _n_poses(factors) if guesses is None else len(guesses)
    check_determined(factors, n_poses)
    problem = Problem.of(factors, n_poses)
    suspects = suspect_factors(factors, n_poses, settings.suspects)
    robust = _with_kernel(problem, settings, suspects)
    stages: list[Stage] = []
    start = chained_poses(factors, n_poses) if guesses is None else guesses
    poses, active = start, np.ones_like(suspects)
    if guesses is None:
        grown = _best_grown_start(robust, suspects, start)
        poses, active = grown.poses, grown.active
        stages.append(_stage("start", robust, start, poses, grown.iterations))
    descent = robust.restricted_to(active).descend(
        poses,
        max_iterations=settings.max_iterations,
        relative_tolerance=settings.relative_tolerance,
        absolute_tolerance=settings.absolute_tolerance,
    )
    stages.append(_stage("robust" if robust.is_robust else "plain", robust, poses, descent.poses, descent.iterations))
    poses = descent.poses
    gate = largest_squared_norm(settings.inlier_probability)
    if not settings.gnc:
        at = robust.evaluate(poses)
        return _result(poses, stages, at.weights, at.weights > 0.5, at.squared, gate)
    plain = problem.with_kernel(None, 1.0, suspects)
    decided = gnc_tls(plain, suspects, _worth_weighing(plain, poses, suspects, gate), poses, gate)
    stages.append(
        Stage(
            name="gnc",
            error_before=decided.error_before,
            error_after=decided.error_after,
            iterations=decided.iterations,
        )
    )
    at = plain.evaluate(decided.poses)
    return _result(decided.poses, stages, np.where(decided.inliers, at.weights, 0.0), decided.inliers, at.squared, gate)


def graph_error(factors: Sequence[Factor], poses: NDArray[np.float64]) -> float:
    """Half the sum of squared, whitened (and robustly weighted) residuals of the factors at (n, 3) poses.

    Raises:
        GraphError: the poses are none, or a factor joins one that is not among them.
    """
    here = _checked_poses(poses, factors)
    return float(Problem.of(factors, len(here)).evaluate(here).losses.sum())


def marginal_covariances(factors: Sequence[Factor], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """How well each pose is known.

    Args:
        factors: at least one prior among them.
        poses: (n, 3) optimised T_map_robot.

    Returns:
        (n, 3, 3) marginal covariances, each in the tangent space at its pose.

    Raises:
        GraphError: the poses are none, or the factors do not determine every one of them.
    """
    here = _checked_poses(poses, factors)
    check_determined(factors, len(here))
    return Problem.of(factors, len(here)).marginal_covariances(here)


def check_determined(factors: Sequence[Factor], n_poses: int, ids: NDArray[np.int64] | None = None) -> None:
    """Every pose is connected, over factors, to a prior.

    Args:
        factors: the records.
        n_poses: number of key poses.
        ids: (n_poses,) what messages call them; 0 … n−1 when left out.

    Raises:
        GraphError: a factor joins a pose that is not there, or a pose is connected to nothing.
    """
    if _hang_on_earlier(*_ends(factors), n_poses):
        return
    neighbours = _factors_at(factors, n_poses)
    open_ends = [factor.j for factor in factors if factor.i is None]
    if not open_ends:
        raise GraphError(f"none of the {len(factors)} factors is a prior: nothing ties the poses to the map")
    connected = [False] * n_poses
    while open_ends:
        here = open_ends.pop()
        if not connected[here]:
            connected[here] = True
            open_ends.extend(_other_end(factor, here) for factor in neighbours[here])
    if not all(connected):
        first = connected.index(False)
        raise GraphError(
            f"{connected.count(False)} of {n_poses} poses are connected to no prior, the first is pose "
            f"{first if ids is None else ids[first]}"
        )


def suspect_factors(
    factors: Sequence[Factor], n_poses: int, kinds: tuple[FactorKind, ...] = ("closure",)
) -> NDArray[np.bool_]:
    """Which factors may be false.

    Args:
        factors: the records.
        n_poses: number of key poses.
        kinds: those of factors that may be false.

    Returns:
        (m,) factors of these kinds, but for those that alone tie a part of the graph to the rest.
    """
    suspects = np.array([factor.kind in kinds for factor in factors], dtype=bool)
    first, second = _ends(factors)
    if _hang_on_earlier(first[~suspects], second[~suspects], n_poses):
        return suspects
    first = np.where(first < 0, n_poses, first)  # the map is a node of its own
    parts = _Parts(n_poses + 1)
    for factor in np.flatnonzero(~suspects).tolist():
        parts.join(int(first[factor]), int(second[factor]))
    for factor in np.flatnonzero(suspects).tolist():
        if parts.join(int(first[factor]), int(second[factor])):
            suspects[factor] = False
    return suspects


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


_WORTH_WEIGHING = 100.0  # times the gate
_WIDER = 6.0
"""Φ of the robust start over that of the solution: a closure that drift has put far off must still pull."""


def _checked_poses(poses: NDArray[np.float64], factors: Sequence[Factor]) -> NDArray[np.float64]:
    """(n, 3) a copy of the poses, all factors' ends among them: the kernels read wherever a factor points."""
    checked = np.array(poses, dtype=np.float64, order="C")
    if checked.ndim != 2 or checked.shape[1] != 3:
        raise GraphError(f"found poses of shape {checked.shape}, expected (n, 3)")
    if not np.isfinite(checked).all():
        raise GraphError("found NaN or infinity in the poses, expected finite numbers")
    second = np.array([factor.j for factor in factors], dtype=np.int64)
    first = np.array([factor.j if factor.i is None else factor.i for factor in factors], dtype=np.int64)
    missed = (np.minimum(first, second) < 0) | (np.maximum(first, second) >= len(checked))
    if missed.any():
        raise _misses(factors[int(missed.argmax())], len(checked))
    return checked


def _misses(factor: Factor, n_poses: int) -> GraphError:
    return GraphError(f"{factor} joins a pose that is not among the {n_poses} there are")


def _n_poses(factors: Sequence[Factor]) -> int:
    return 1 + max((max(factor.j, -1 if factor.i is None else factor.i) for factor in factors), default=-1)


def _with_kernel(problem: Problem, settings: BatchConfig, suspects: NDArray[np.bool_]) -> Problem:
    if settings.kernel == "given":
        return problem.with_kernel("dcs", settings.kernel_width, suspects) if settings.gnc else problem
    if settings.kernel == "none":
        return problem.with_kernel("dcs" if settings.gnc else None, settings.kernel_width, suspects)
    return problem.with_kernel(settings.kernel, settings.kernel_width, suspects)


class _Parts:
    """Which poses hang together (disjoint sets)."""

    def __init__(self, n: int) -> None:
        self._parent = list(range(n))

    def join(self, a: int, b: int) -> bool:
        """Tie two poses; whether that joins parts that were separate."""
        a, b = self._root(a), self._root(b)
        self._parent[b] = a
        return a != b

    def _root(self, a: int) -> int:
        while self._parent[a] != a:
            self._parent[a] = self._parent[self._parent[a]]
            a = self._parent[a]
        return a


def _best_grown_start(problem: Problem, suspects: NDArray[np.bool_], chained: NDArray[np.float64]) -> GrownStart:
    """Grown with the kernels as they are and, if some suspects were left out then, with wider ones: the lower error."""
    fade_at = problem.fade_at(suspects)
    narrow = grown_start(problem, suspects, chained, fade_at)
    if fade_at is None or (problem.evaluate(narrow.poses).weights[suspects] > 0.5).all():
        return narrow
    wide = grown_start(problem.with_kernel("dcs", _WIDER * fade_at, suspects), suspects, chained, fade_at)
    return min(narrow, wide, key=lambda grown: float(problem.evaluate(grown.poses).losses.sum()))


def _worth_weighing(
    problem: Problem, poses: NDArray[np.float64], suspects: NDArray[np.bool_], gate: float
) -> NDArray[np.bool_]:
    return np.asarray(~suspects | (problem.evaluate(poses).squared < _WORTH_WEIGHING * gate))


def _stage(
    name: str, problem: Problem, before: NDArray[np.float64], after: NDArray[np.float64], iterations: int
) -> Stage:
    return Stage(
        name=name,
        error_before=float(problem.evaluate(before).losses.sum()),
        error_after=float(problem.evaluate(after).losses.sum()),
        iterations=iterations,
    )


def _result(
    poses: NDArray[np.float64],
    stages: list[Stage],
    weights: NDArray[np.float64],
    inliers: NDArray[np.bool_],
    squared: NDArray[np.float64],
    gate: float,
) -> BatchResult:
    return BatchResult(
        poses=poses,
        error_before=stages[0].error_before,
        error_after=stages[-1].error_after,
        iterations=sum(stage.iterations for stage in stages),
        weights=weights,
        inliers=inliers,
        squared_norms=squared,
        gate=gate,
        stages=tuple(stages),
    )


def _ends(factors: Sequence[Factor]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(m,) poses that factors join, -1 for the map."""
    first = np.array([-1 if factor.i is None else factor.i for factor in factors], dtype=np.int64)
    return first, np.array([factor.j for factor in factors], dtype=np.int64)


def _hang_on_earlier(i: NDArray[np.int64], j: NDArray[np.int64], n_poses: int) -> bool:
    """Whether every pose is joined to one before it, or to the map (-1), as along a path: then all hang together."""
    earlier, later = np.minimum(i, j), np.maximum(i, j)
    if not len(later) or earlier.min() < -1 or later.max() >= n_poses:
        return False
    hangs = np.zeros(n_poses, dtype=np.bool_)
    hangs[later[earlier < later]] = True
    return bool(hangs.all())


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
            raise _misses(factor, n_poses)
        if factor.i is not None:
            at[factor.i].append(factor)
            at[factor.j].append(factor)
    return at
