"""Any planar pose graph made right: which of its edges are closures, which of them hold, the most likely poses."""

import math
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from graph.batch import (
    BatchConfig,
    BatchResult,
    KernelChoice,
    chained_poses,
    check_determined,
    graph_error,
    optimize,
    suspect_factors,
)
from graph.consistency import consistent_closures
from graph.factors import Factor, KernelName, RobustKernel
from graph.g2o import G2oGraph
from graph.pose_graph import PoseGraph
from graph.se2 import compose

Reason = Literal["pcm", "gnc", "kernel"]

_REJECTED_SHOWN = 20


@dataclass(frozen=True, kw_only=True)
class OptimizeOptions:
    """How a pose graph is solved.

    Attributes:
        kernel: robust kernel of the closures; "given" keeps what the file says.
        kernel_width: its width (for "dcs" Φ).
        gnc: decide which closures hold by graduated non-convexity, after a robust stage.
        pcm: drop first the closures outside the largest pairwise consistent set.
        incremental: one pose after the other with iSAM2, then all at once from there; else all at once only.
    """

    kernel: KernelChoice = "given"
    kernel_width: float = 5.0
    gnc: bool = False
    pcm: bool = False
    incremental: bool = False


@dataclass(frozen=True, kw_only=True)
class RejectedEdge:
    """A closure that does not hold.

    Attributes:
        id_i: vertex id it is seen from.
        id_j: vertex id that is seen.
        squared_norm: its squared, whitened residual at the solution.
        reason: who rejected it: pairwise consistency, GNC, or a kernel that leaves it less than half its weight.
    """

    id_i: int
    id_j: int
    squared_norm: float
    reason: Reason


@dataclass(frozen=True, kw_only=True)
class OptimizedGraph:
    """A solved pose graph and what became of its edges.

    Attributes:
        ids: (n,) vertex ids.
        poses: (n, 3) T_map_robot.
        factors: those that hold; edges a kernel merely weakened stay.
        n_odometry: edges between neighbouring vertices, taken as true.
        n_closures: all others.
        rejected: closures that do not hold.
        initial_error: half the sum of squares of the edges that hold, at the file's vertices, without kernels.
        final_error: the same at `poses`.
        iterations: steps taken over all poses at once.
    """

    ids: NDArray[np.int64]
    poses: NDArray[np.float64]
    factors: tuple[Factor, ...]
    n_odometry: int
    n_closures: int
    rejected: tuple[RejectedEdge, ...]
    initial_error: float
    final_error: float
    iterations: int


def optimize_g2o(graph: G2oGraph, options: OptimizeOptions | None = None) -> OptimizedGraph:
    """Solve a pose graph as `graph.g2o.read_g2o` reads it.

    Args:
        graph: vertices and edges.
        options: which defences against false closures.

    Returns:
        The solution and what became of every closure.

    Raises:
        GraphError: a vertex is connected to nothing, or the graph cannot be solved.
    """
    settings = options or OptimizeOptions()
    n = len(graph.poses)
    check_determined(graph.factors, n, graph.ids)
    agreeing = _pairwise_consistent(graph.factors, n) if settings.pcm else np.ones(len(graph.factors), dtype=bool)
    considered = [factor for factor, agrees in zip(graph.factors, agreeing, strict=True) if agrees]
    batch = BatchConfig(kernel=settings.kernel, kernel_width=settings.kernel_width, gnc=settings.gnc)
    result = _solved_incrementally(considered, n, batch) if settings.incremental else _solved(considered, graph, batch)
    holds = agreeing.copy()
    holds[agreeing] = result.inliers
    plain = [replace(factor, kernel=None) for factor, held in zip(graph.factors, holds, strict=True) if held]
    return OptimizedGraph(
        ids=graph.ids,
        poses=result.poses,
        factors=tuple(f for f, inlier in zip(considered, result.inliers, strict=True) if inlier or not settings.gnc),
        n_odometry=sum(factor.kind in {"odometry", "ice"} for factor in graph.factors),
        n_closures=sum(factor.kind == "closure" for factor in graph.factors),
        rejected=_rejected(graph, agreeing, result, "gnc" if settings.gnc else "kernel"),
        initial_error=graph_error(plain, graph.poses),
        final_error=graph_error(plain, result.poses),
        iterations=result.iterations,
    )


def format_report(solved: OptimizedGraph) -> str:
    """What a person wants to know: sizes, errors, and each closure that does not hold."""
    lines = [
        f"{len(solved.ids)} vertices, {solved.n_odometry} edges along the way, {solved.n_closures} closures",
        f"error {solved.initial_error:.6g} -> {solved.final_error:.6g} (edges that hold), {solved.iterations} steps",
        f"{len(solved.rejected)} closures do not hold" + (":" if solved.rejected else ""),
    ]
    lines += [
        f"  {edge.id_i} -> {edge.id_j}: {math.sqrt(edge.squared_norm):.1f} standard deviations off ({edge.reason})"
        for edge in solved.rejected[:_REJECTED_SHOWN]
    ]
    more = len(solved.rejected) - _REJECTED_SHOWN
    return "\n".join([*lines, f"  and {more} more"] if more > 0 else lines)


def _solved(factors: list[Factor], graph: G2oGraph, config: BatchConfig) -> BatchResult:
    """From the file's vertices and from the factors alone: the better of the two."""
    results = (optimize(factors, None, config), optimize(factors, graph.poses, config))
    return min(results, key=_truncated_error)


def _truncated_error(result: BatchResult) -> float:
    """Error with the gate's price for every factor that was rejected: fewer factors alone are no better solution."""
    worth = result.gate / 2.0
    return result.error_after + (worth * float((~result.inliers).sum()) if result.stages[-1].name == "gnc" else 0.0)


def _solved_incrementally(factors: list[Factor], n: int, config: BatchConfig) -> BatchResult:
    by_newest: list[list[Factor]] = [[] for _ in range(n)]
    for factor in factors:
        by_newest[max(factor.j, -1 if factor.i is None else factor.i)].append(_growing(factor, config))
    guesses, growing, is_tied = chained_poses(factors, n), PoseGraph(), False
    for key, arriving in enumerate(by_newest):
        step = next((factor.T_i_j for factor in arriving if factor.i == key - 1 and factor.kind != "closure"), None)
        growing.add_pose(guesses[key] if step is None or not is_tied else compose(growing.pose(key - 1), step))
        for factor in arriving:
            growing.add(factor)
        is_tied = not growing.has_loose_poses
        if is_tied:
            growing.update()
    return optimize(factors, growing.all_poses(), config)


def _growing(factor: Factor, config: BatchConfig) -> Factor:
    """A factor with the kernel it has while the graph grows."""
    if factor.kind != "closure" or (config.kernel == "given" and not config.gnc):
        return factor
    name = "dcs" if config.kernel in {"given", "none"} else config.kernel
    if config.kernel == "none" and not config.gnc:
        return replace(factor, kernel=None)
    return replace(factor, kernel=RobustKernel(name=cast("KernelName", name), width=config.kernel_width))


def _pairwise_consistent(factors: tuple[Factor, ...], n: int) -> NDArray[np.bool_]:
    is_suspect = suspect_factors(factors, n)
    closures = [factor for factor, suspect in zip(factors, is_suspect, strict=True) if suspect]
    along = [factor for factor, suspect in zip(factors, is_suspect, strict=True) if not suspect]
    agreeing = np.ones(len(factors), dtype=bool)
    agreeing[is_suspect] = consistent_closures(closures, chained_poses(along, n), along)
    return agreeing


def _rejected(
    graph: G2oGraph, agreeing: NDArray[np.bool_], result: BatchResult, reason: Reason
) -> tuple[RejectedEdge, ...]:
    from graph.problem import Problem

    squared = Problem.of(graph.factors, len(graph.poses)).evaluate(result.poses).squared
    held = np.zeros(len(graph.factors), dtype=bool)
    held[agreeing] = result.inliers
    return tuple(
        RejectedEdge(
            id_i=int(graph.ids[factor.i]),
            id_j=int(graph.ids[factor.j]),
            squared_norm=float(squared[k]),
            reason=reason if agreeing[k] else "pcm",
        )
        for k, factor in enumerate(graph.factors)
        if not held[k] and factor.i is not None
    )
