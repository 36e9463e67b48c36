"""The offline finish: all factors at once, matches again between optimised neighbours, then poses and map together."""

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from frontends.scan import Scan
from graph.arrays import Floats
from graph.batch import optimize
from graph.factors import Factor, RobustKernel
from graph.noise import chi2_gate
from graph.problem import Problem
from iceg.ice._noise_kernels import RangeNoise
from iceg.ice.noise import PLAIN
from iceg.slam.broken_path.lost_steps import without_lost_steps
from iceg.slam.broken_path.path_break import Outcome
from iceg.slam.closures.attempt import closure_factor
from iceg.slam.closures.record import with_earlier, without_contradicted
from iceg.slam.config import FinishConfig, LoopClosureConfig
from iceg.slam.joint.covariance import PoseInformation
from iceg.slam.joint.refinement import JointRefinement, key_clouds, refine_jointly
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
        solution: its factors with the covariances in which one may believe, see `without_lost_steps`; the poses are
            those of poses and map refined together, if they were.
        rounds: one entry for each.
        covariances: (k, 3, 3) marginal covariances of the poses, None where only the graph knows them.
        information: what these rest on, None where they are.
        walls: the pieces of wall that the joint refinement ended with, none without it.
        warnings: of what the covariances claim.
    """

    solution: Solution
    rounds: list[Round]
    covariances: Floats | None = None
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
        The solution with every closure under a robust kernel, those last, and one entry for each round; the solution as
        it is, and none, where the finish is switched off or there is nothing to match.
    """
    if not config.enabled or len(track.keys) < 2:
        return solution, []
    limits = replace(closures, max_passes=config.max_passes)
    closer = LoopCloser(matcher, track, limits, _parts(solution), is_forbidden, stages)
    closer.passes.searchable[:] = solution.searchable
    clock, kernel = _Clock(), closure_kernel(config)
    chain = [factor for factor in solution.factors if factor.kind != "closure" or factor in kept]
    loops = [replace(f, kernel=kernel) for f in solution.factors if f.kind == "closure" and f not in kept]
    poses, done = _solved("solve", chain, loops, solution.poses, clock, stages)
    attempts, rounds = solution.attempts, [done]
    for _ in range(config.rounds if closures.enabled else 0):
        joined = {loop.pair for loop in loops}
        sure, outliers = _judged(loops, poses)
        tried = match_again(closer, poses, sure, outliers, config)
        attempts = with_earlier(tried, attempts)
        loops = [*sure, *(closure_factor(attempt, kernel) for attempt in tried if attempt.accepted)]
        poses, done = _solved("rematch", chain, loops, poses, clock, stages)
        rounds.append(replace(done, fresh=len({loop.pair for loop in loops} - joined)))
        if done.largest_move < config.tolerance:
            break
    return replace(solution, factors=[*chain, *loops], poses=poses, attempts=attempts), rounds


def refined(
    solution: Solution,
    rounds: Sequence[Round],
    track: Track,
    matcher: MapMatcher,
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
        config: of the refinement.
        scan_of: the scans of the log by index, so that those between key scans take part in the joint refinement.
        noise: of the ranges beyond what the settings allow for.
        distrusted: key poses whose points are not to be believed.

    Returns:
        The final poses and factors; the poses as they are where the finish is switched off, or there is one alone.
    """
    if not config.enabled or len(track.keys) < 2:
        measured = without_lost_steps(solution.factors, solution.breaks)
        return Finished(solution=replace(solution, factors=measured), rounds=[])
    clock = _Clock()
    attempts, loops = without_contradicted(
        solution.attempts,
        [factor for factor in solution.factors if _is_robust(factor)],
        solution.poses,
        config.outlier_weight,
    )
    solved = [*(factor for factor in solution.factors if not _is_robust(factor)), *loops]
    # Odometry still holds in their place, while poses and map are refined, the parts that nothing else ties.
    measured = without_lost_steps(solved, solution.breaks)
    found, done = replace(solution, factors=measured, attempts=attempts), list(rounds)
    if not config.joint.enabled:
        return Finished(solution=found, rounds=done)
    clouds = key_clouds(track, scan_of, config.joint, noise).without(distrusted)
    if matcher.judge is matcher:  # what halves of scans say of ICE they say of the points
        clouds = replace(clouds, variance_scale=track.match_covariance_scale)
    joint = refine_jointly(solved, found.poses, clouds, config.joint, _parts(found), measured)
    warning = claims_warning(joint.variance_factor, config.joint, are_walls_believed=joint.covariances is not None)
    return Finished(
        solution=replace(found, poses=joint.poses),
        rounds=[*done, _joint_round(joint, found.poses, len(loops), clock)],
        covariances=joint.covariances,
        information=joint.information,
        walls=joint.walls,
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


def _judged(loops: Sequence[Factor], poses: Floats) -> tuple[list[Factor], list[Factor]]:
    """The closures that agree with the poses, and those that their robust kernel takes for outliers."""
    if not loops:
        return [], []
    weights = Problem.of(loops, len(poses)).evaluate(poses).weights.tolist()
    pairs = list(zip(loops, weights, strict=True))
    return [loop for loop, weight in pairs if weight >= 1.0], [loop for loop, weight in pairs if weight < 1.0]


def _is_robust(factor: Factor) -> bool:
    return factor.kind == "closure" and factor.kernel is not None


def _parts(solution: Solution) -> list[int]:
    """Key poses at which a part begins that nothing ties to what was before."""
    parts = [found.key for found in solution.breaks if found.outcome is Outcome.APART]
    return parts + [vote.first for vote in solution.ambiguous]


def _solved(
    stage: Stage, chain: Sequence[Factor], loops: Sequence[Factor], guess: Floats, clock: _Clock, stages: Stages
) -> tuple[Floats, Round]:
    """The (k, 3) optimum of path and closures together."""
    factors = [*chain, *loops]
    if stages.solver is None:
        result = optimize(factors, guess, BATCH)
        poses, before, after = result.poses, result.error_before, result.error_after
    else:
        poses = checked_poses(stages.solver(factors, guess), len(guess))
        problem = Problem.of(factors, len(poses))
        before, after = (float(problem.evaluate(at).losses.sum()) for at in (guess, poses))
    largest, mean = _moves(guess, poses)
    return poses, Round(
        stage=stage,
        closures=len(loops),
        error_before=before,
        error=after,
        largest_move=largest,
        mean_move=mean,
        seconds=clock.lap(),
    )


def _moves(before: Floats, after: Floats) -> tuple[float, float]:
    """Largest and mean distance [m] between two estimates of the key poses."""
    distances = np.hypot(*(after - before)[:, :2].T)
    return float(distances.max()), float(distances.mean())


def _joint_round(joint: JointRefinement, before: Floats, closures: int, clock: _Clock) -> Round:
    """What the joint refinement did."""
    largest, mean = _moves(before, joint.poses)
    return Round(
        stage="joint",
        closures=closures,
        error_before=joint.error_before,
        error=joint.error,
        largest_move=largest,
        mean_move=mean,
        residual_before=joint.residual_before,
        residual=joint.residual,
        covariances_from="graph" if joint.covariances is None else "walls",
        walls_share=round(joint.share, 4),
        variance_factor=round(joint.variance_factor, 4),
        seconds=clock.lap(),
    )
