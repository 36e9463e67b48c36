"""Closures that the path refused on the way, weighed once more when all of them are known.

A closure that the path does not explain is more likely a similar place than the path wrong, and it is refused. Many
that say the same are right all the same where one match, or one closure, led the path astray. In the end both are
weighed by truncated least squares (Yang et al., *Graduated non-convexity for robust spatial perception*, 2020): what
does not hold, match or closure, costs as much each, so that the explanation wins that leaves less over and strains
odometry less. Something must have led the path astray: where nothing else has to go, many that slid along one wall say
the same, and are no witnesses against the path.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from graph.arrays import Floats
from graph.batch import BatchResult, optimize
from graph.consistency import cumulative_covariances, maximum_clique, pairwise_consistency
from graph.factors import Factor, FactorKind, RobustKernel
from graph.noise import largest_squared_norm
from iceg.slam.closures.attempt import Attempt, closure_factor
from iceg.slam.config import LoopClosureConfig
from iceg.slam.solution import BATCH, Solution

_SUSPECTS: tuple[FactorKind, ...] = ("closure", "ice")
"""What may be wrong altogether; what is known of the rest is how far it errs."""


def with_hindsight(solution: Solution, config: LoopClosureConfig, contested: Mapping[int, Floats]) -> Solution:
    """Let closures in that the path alone refused, where what those that agree say is more probable than the path.

    Args:
        solution: the graph as it was found on the way.
        config: how far a true closure may be off, and how many must say the same.
        contested: by the key poses whose match contradicts odometry, (3, 3) how well odometry knows the step if the
            match is wrong; the graph has it wider, as if the match were right.

    Returns:
        The solution; where closures come in, what they refute is out.
    """
    path = [factor for factor in solution.factors if factor.kind in {"odometry", "ice"}]
    refused = _refused_by_path(solution.attempts, config)
    for agreeing in _agreeing_sets(refused, path, solution.poses, config.confirmations):
        if len(agreeing) >= config.confirmations:
            solution = weighed(solution, agreeing, config, contested)
    return solution


def _refused_by_path(attempts: Sequence[Attempt], config: LoopClosureConfig) -> list[Attempt]:
    """Those that would have been accepted had the path explained them."""
    most = largest_squared_norm(config.path_probability)
    return [attempt for attempt in attempts if not attempt.accepted and attempt.off_path**2 > most]


def _agreeing_sets(
    closures: Sequence[Attempt], path: Sequence[Factor], poses: Floats, fewest: int
) -> list[list[Attempt]]:
    """Sets of closures that agree pairwise along a path of (k, 3) poses, the largest first."""
    cumulative = cumulative_covariances(path, poses)
    agree = pairwise_consistency([closure_factor(closure) for closure in closures], poses, cumulative)
    left, sets = np.arange(len(closures)), []
    while len(left) >= fewest:
        members = maximum_clique(agree[np.ix_(left, left)])
        sets.append([closures[index] for index in left[members].tolist()])
        left = left[~members]
    return sorted(sets, key=len, reverse=True)


def weighed(
    solution: Solution, refused: Sequence[Attempt], config: LoopClosureConfig, contested: Mapping[int, Floats]
) -> Solution:
    """The more probable of the path and of what some closures say that agree; see `with_hindsight`."""
    claims = [closure_factor(attempt) for attempt in refused]
    before = [_with_doubt(factor, contested) for factor in solution.factors]
    gate = largest_squared_norm(config.path_probability)
    kernel = RobustKernel(name="dcs", width=gate)
    yielding = [replace(factor, kernel=kernel) if factor.kind in _SUSPECTS else factor for factor in before]
    led = optimize([*yielding, *claims], solution.poses, BATCH).poses
    ways = (_explained([*before, *claims], poses, config) for poses in (solution.poses, led))
    found = min(ways, key=_cost)
    holds = found.inliers.tolist()
    let_in = {id(attempt) for attempt, held in zip(refused, holds[len(solution.factors) :], strict=True) if held}
    has_culprit = not all(holds[: len(solution.factors)])
    if not has_culprit or len(let_in) < config.confirmations:
        return solution
    path = _explained(before, solution.poses, config)
    if _cost(found) >= _cost(path) + 0.5 * gate * len(claims):
        return solution
    judged = list(zip([*solution.factors, *claims], holds, strict=True))
    refuted = {factor.j for factor, held in judged if factor.kind == "ice" and not held}
    factors = [_as_known(factor, contested) if factor.j in refuted else factor for factor, held in judged if held]
    closed = {factor.pair for factor in factors if factor.kind == "closure"}
    return replace(
        solution,
        factors=factors,
        poses=found.poses,
        attempts=[_judged(attempt, closed, is_let_in=id(attempt) in let_in) for attempt in solution.attempts],
    )


def _with_doubt(factor: Factor, contested: Mapping[int, Floats]) -> Factor:
    """A factor as hindsight weighs it: a match that odometry does not contradict counts as what is known."""
    if factor.kind == "ice" and factor.j not in contested:
        return replace(factor, kind="odometry")
    return _as_known(factor, contested)


def _as_known(factor: Factor, contested: Mapping[int, Floats]) -> Factor:
    """Odometry as well known as if the match that contradicts it were wrong; any other factor as it is."""
    if factor.kind == "odometry" and factor.j in contested:
        return replace(factor, covariance=contested[factor.j])
    return factor


def _judged(attempt: Attempt, closed: Collection[tuple[int | None, int]], *, is_let_in: bool) -> Attempt:
    if is_let_in:
        return attempt.judged("in hindsight", accepted=True)
    if attempt.accepted and attempt.pair not in closed:
        return attempt.taken_out("refuted in hindsight")
    return attempt


def _explained(factors: Sequence[Factor], poses: Floats, config: LoopClosureConfig) -> BatchResult:
    """What holds of all that was measured, by truncated least squares, from (k, 3) poses on."""
    settings = replace(
        BATCH,
        gnc=True,
        kernel_width=largest_squared_norm(config.path_probability),
        inlier_probability=config.path_probability,
        suspects=_SUSPECTS,
    )
    return optimize(factors, poses, settings)


def _cost(explanation: BatchResult) -> float:
    """Half the sum of squares, that of what does not hold cut at the gate."""
    return explanation.error_after + 0.5 * explanation.gate * np.count_nonzero(~explanation.inliers)
