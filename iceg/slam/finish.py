"""The offline finish: all factors at once, matches again between optimised neighbours, then poses and map together."""

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from graph.batch import optimize
from graph.factors import Factor, RobustKernel
from graph.noise import chi2_gate
from graph.problem import Problem
from iceg.ice._point_kernels import RangeNoise
from iceg.ice.noise import PLAIN
from iceg.slam.broken_path.path_break import Outcome
from iceg.slam.closures.attempt import Attempt, closure_factor
from iceg.slam.closures.record import with_earlier, without_contradicted
from iceg.slam.config import FinishConfig, LoopClosureConfig
from iceg.slam.final_factors import FinalFactors
from iceg.slam.joint.covariance import PoseInformation
from iceg.slam.joint.refinement import Clouds, JointRefinement, key_clouds, refine_jointly
from iceg.slam.joint.wall_claims import claims_warning
from iceg.slam.joint.wall_pieces import WallPieces
from iceg.slam.loop_closure import Forbids, LoopCloser
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.rematch import match_again
from iceg.slam.run_warning import RunWarning
from iceg.slam.solution import BATCH, Solution
from iceg.slam.stages import IN_HOUSE, Stages, checked_poses
from iceg.slam.track import Track

Stage = Literal["solve", "rematch", "joint"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    """What one stage or round of the finish did.

    Attributes:
        stage: "solve" of the graph as it was found, "rematch" of key scans to their neighbours, or "joint" refinement
            of poses and map.
        closures: in force after it.
        fresh: of these, between key poses that no closure joined before.
        error_before: half the sum of squared whitened residuals of its factors at the start …
        error: … and after it.
        largest_move: of a key pose [m].
        mean_move: of the key poses [m].
        residual_before: root mean square distance of the points from the walls before a joint refinement [m] …
        residual: … and after it.
        covariances_from: whence the key poses' covariances are after a joint refinement: "walls" that scans share, or
            the "graph" alone, where the points on walls do not determine every pose.
        walls_share: of the way from the graph's optimum to that of the walls that the key poses went …
        variance_factor: … and how many times as far, squared, as both claim; in the covariances.
        seconds: spent.
    """

    stage: Stage
    closures: int
    fresh: int = 0
    error_before: float
    error: float
    largest_move: float
    mean_move: float
    residual_before: float | None = None
    residual: float | None = None
    covariances_from: Literal["walls", "graph"] | None = None
    walls_share: float | None = None
    variance_factor: float | None = None
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """The finished graph.

    Attributes:
        poses: (k, 3) T_map_robot of the key poses.
        factors: those in force.
        attempts: the record of all closures tried.
        rounds: one entry for each.
        covariances: (k, 3, 3) marginal covariances of the poses, None where only the graph knows them.
        information: what these rest on, None where they are.
        walls: the pieces of wall that the joint refinement ended with, none without it.
        warnings: of what the covariances claim.
    """

    poses: NDArray[np.float64]
    factors: FinalFactors
    attempts: list[Attempt]
    rounds: list[Round]
    covariances: NDArray[np.float64] | None = None
    information: PoseInformation | None = None
    walls: WallPieces = field(default_factory=WallPieces.none)
    warnings: tuple[RunWarning, ...] = ()


def matched_again(
    solution: Solution,
    track: Track,
    matcher: MapMatcher,
    closures: LoopClosureConfig,
    config: FinishConfig,
    *,
    kept: Sequence[Factor] = (),
    is_forbidden: Forbids | None = None,
    stages: Stages = IN_HOUSE,
) -> tuple[Solution, list[Round]]:
    """All factors at once, and matches again between the optimised neighbours.

    Args:
        solution: the graph so far, its record of closures, and where its path is broken.
        track: key scans.
        matcher: for re-matching.
        closures: what counts as a closure.
        config: rounds and tolerances.
        kept: those of the factors that are closures without a robust kernel, as those added by hand.
        is_forbidden: whether a closure between two key poses must not be.
        stages: verification and solver of the caller's own.

    Returns:
        The solution with every closure under a robust kernel, those last, and one entry for each round.
    """
    limits = replace(closures, max_passes=config.max_passes)
    closer = LoopCloser(matcher, track, limits, _parts(solution), is_forbidden, stages)
    closer.passes.searchable[:] = solution.searchable
    clock = _Clock()
    graph, done = _solved("solve", _Graph.of(solution, kept, config), clock, stages)
    rounds = [done]
    for _ in range(config.rounds if closures.enabled or closures.revisits else 0):
        before = graph
        graph, done = _solved("rematch", _rematched(graph, closer, track, config), clock, stages)
        largest, mean = _moves(before.poses, graph.poses)
        rounds.append(replace(done, fresh=len(graph.joined - before.joined), largest_move=largest, mean_move=mean))
        if largest < config.tolerance:
            break
    return replace(solution, factors=[*graph.chain, *graph.loops], poses=graph.poses, attempts=graph.attempts), rounds


def refined(
    solution: Solution,
    rounds: Sequence[Round],
    track: Track,
    matcher: MapMatcher,
    closures: LoopClosureConfig,
    config: FinishConfig,
    *,
    scan_of: Callable[[int], Scan],
    noise: RangeNoise = PLAIN,
    distrusted: Collection[int] = (),
) -> Finished:
    """The closures that the rest contradicts taken out, then poses and map refined together.

    Args:
        solution: the graph at its optimum, each closure that is not pinned under a robust kernel.
        rounds: what was done before.
        track: key scans.
        matcher: that matched them.
        closures: what counts as a closure.
        config: of the refinement.
        scan_of: the scans of the log by index, so that those between key scans take part in the joint refinement.
        noise: of the ranges beyond what the settings allow for.
        distrusted: key poses whose points are not to be believed.

    Returns:
        The final poses and factors.
    """
    clock, factors = _Clock(), solution.factors
    chain = [factor for factor in factors if not _is_robust(factor)]
    attempts, loops = without_contradicted(
        solution.attempts,
        [factor for factor in factors if _is_robust(factor)],
        solution.poses,
        config.outlier_weight,
    )
    poses, done = solution.poses, list(rounds)
    covariances, information, walls, warning = None, None, WallPieces.none(), None
    final = FinalFactors.of([*chain, *loops], solution.breaks, closures.relocalisation.min_credible)
    if config.joint.enabled:
        clouds = key_clouds(track, scan_of, config.joint, noise).without(distrusted)
        if matcher.judge is matcher:  # what halves of scans say of ICE they say of the points
            clouds = replace(clouds, variance_scale=track.match_covariance_scale)
        joint, last = _joint(final, poses, clouds, config, _parts(solution), clock)
        poses, covariances = joint.poses, joint.covariances
        information, walls = joint.information, joint.walls
        warning = claims_warning(joint.variance_factor, config.joint, are_walls_believed=covariances is not None)
        done.append(replace(last, closures=len(loops)))
    return Finished(
        poses=poses,
        factors=final,
        attempts=attempts,
        rounds=done,
        covariances=covariances,
        information=information,
        walls=walls,
        warnings=() if warning is None else (warning,),
    )


def closure_kernel(config: FinishConfig) -> RobustKernel:
    """The robust kernel of a closure that is not pinned."""
    return RobustKernel(name="dcs", width=chi2_gate(config.closure_false_alarm))


class _Clock:
    """Seconds from one stage to the next."""

    def __init__(self) -> None:
        self._last = time.perf_counter()

    def lap(self) -> float:
        last, self._last = self._last, time.perf_counter()
        return round(self._last - last, 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Graph:
    """The graph between two steps of the finish.

    Attributes:
        poses: (k, 3) T_map_robot of the key poses.
        chain: the factors without a robust kernel.
        loops: the closures in force, each with its robust kernel.
        attempts: the record of all closures tried.
    """

    poses: NDArray[np.float64]
    chain: list[Factor]
    loops: list[Factor]
    attempts: list[Attempt]

    @classmethod
    def of(cls, solution: Solution, kept: Sequence[Factor], config: FinishConfig) -> "_Graph":
        factors, kernel = solution.factors, closure_kernel(config)
        chain = [factor for factor in factors if factor.kind != "closure" or factor in kept]
        loops = [replace(f, kernel=kernel) for f in factors if f.kind == "closure" and f not in kept]
        return cls(poses=solution.poses, chain=chain, loops=loops, attempts=solution.attempts)

    @property
    def joined(self) -> set[tuple[int | None, int]]:
        """Key poses that closures join."""
        return {(factor.i, factor.j) for factor in self.loops}

    def judged(self) -> tuple[list[Factor], list[Factor]]:
        """The closures that agree with the poses, and those that their robust kernel takes for outliers."""
        if not self.loops:
            return [], []
        weights = Problem.of(self.loops, len(self.poses)).evaluate(self.poses).weights.tolist()
        pairs = list(zip(self.loops, weights, strict=True))
        return [loop for loop, weight in pairs if weight >= 1.0], [loop for loop, weight in pairs if weight < 1.0]

    def with_tried(self, sure: list[Factor], tried: list[Attempt], config: FinishConfig) -> "_Graph":
        """The same with the closures that stay and those of the last attempts that were accepted."""
        kernel = closure_kernel(config)
        fresh = [closure_factor(attempt, kernel) for attempt in tried if attempt.accepted]
        return replace(self, loops=[*sure, *fresh], attempts=with_earlier(tried, self.attempts))


def _is_robust(factor: Factor) -> bool:
    return factor.kind == "closure" and factor.kernel is not None


def _parts(solution: Solution) -> list[int]:
    """Key poses at which a part begins that nothing ties to what was before."""
    parts = [found.key for found in solution.breaks if found.outcome is Outcome.APART]
    return parts + [vote.first for vote in solution.ambiguous]


def _rematched(graph: _Graph, closer: LoopCloser, track: Track, config: FinishConfig) -> _Graph:
    """The graph with closures where none tied two passes, and with the outliers tried again."""
    sure, outliers = graph.judged()
    tried = match_again(closer, track, graph.poses, sure, outliers, config)
    return graph.with_tried(sure, tried, config)


def _solved(stage: Stage, graph: _Graph, clock: _Clock, stages: Stages) -> tuple[_Graph, Round]:
    factors = [*graph.chain, *graph.loops]
    if stages.solver is None:
        result = optimize(factors, graph.poses, BATCH)
        poses, before, after = result.poses, result.error_before, result.error_after
    else:
        poses = checked_poses(stages.solver(factors, graph.poses), len(graph.poses))
        problem = Problem.of(factors, len(poses))
        before, after = (float(problem.evaluate(at).losses.sum()) for at in (graph.poses, poses))
    largest, mean = _moves(graph.poses, poses)
    return replace(graph, poses=poses), Round(
        stage=stage,
        closures=len(graph.loops),
        error_before=before,
        error=after,
        largest_move=largest,
        mean_move=mean,
        seconds=clock.lap(),
    )


def _moves(before: NDArray[np.float64], after: NDArray[np.float64]) -> tuple[float, float]:
    """Largest and mean distance [m] between two estimates of the key poses."""
    distances = np.hypot(*(after - before)[:, :2].T)
    return float(distances.max()), float(distances.mean())


def _joint(
    factors: FinalFactors,
    poses: NDArray[np.float64],
    clouds: Clouds,
    config: FinishConfig,
    parts: Sequence[int],
    clock: _Clock,
) -> tuple[JointRefinement, Round]:
    """Refine poses and map together."""
    refined = refine_jointly(factors.solved, poses, clouds, config.joint, parts, factors.measured)
    largest, mean = _moves(poses, refined.poses)
    return (
        refined,
        Round(
            stage="joint",
            closures=0,
            error_before=refined.error_before,
            error=refined.error,
            largest_move=largest,
            mean_move=mean,
            residual_before=refined.residual_before,
            residual=refined.residual,
            covariances_from="graph" if refined.covariances is None else "walls",
            walls_share=round(refined.share, 4),
            variance_factor=round(refined.variance_factor, 4),
            seconds=clock.lap(),
        ),
    )
