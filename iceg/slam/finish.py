"""The offline finish: optimise all factors at once, match again between optimised neighbours, until nothing moves."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frontends.matcher import Matcher
from graph.batch import BatchConfig, optimize
from graph.factors import Factor, RobustKernel
from graph.se2 import between
from iceg.slam.config import FinishConfig, LoopClosureConfig
from iceg.slam.loop_closure import Attempt, LoopCloser
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    """What one round of the finish did.

    Attributes:
        closures: accepted in it.
        error: half the sum of squared whitened residuals after it.
        largest_move: of a key pose [m].
    """

    closures: int
    error: float
    largest_move: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """The finished graph.

    Attributes:
        poses: (k, 3) T_map_robot of the key poses.
        factors: those in force at the end.
        attempts: the closures tried in the last round, empty if none was.
        rounds: one entry for each.
    """

    poses: NDArray[np.float64]
    factors: list[Factor]
    attempts: list[Attempt]
    rounds: list[Round]


def finish(
    factors: list[Factor],
    poses: NDArray[np.float64],
    track: Track,
    matcher: Matcher,
    closures: LoopClosureConfig,
    config: FinishConfig,
    progress: Callable[[int], None] | None = None,
) -> Finished:
    """Make the trajectory as good as the data allows.

    Args:
        factors: of the graph so far.
        poses: (k, 3) its solution.
        track: key scans.
        matcher: for re-matching.
        closures: what counts as a closure.
        config: rounds and tolerances.
        progress: called with the number of rounds done.

    Returns:
        The final poses and factors.
    """
    kernel = RobustKernel(name="dcs", width=config.kernel_width)
    chain = [factor for factor in factors if factor.kind != "closure"]
    loops = [replace(factor, kernel=kernel) for factor in factors if factor.kind == "closure"]
    result = optimize([*chain, *loops], poses, _BATCH)
    rounds = [Round(closures=len(loops), error=result.error_after, largest_move=_largest_move(poses, result.poses))]
    poses, attempts = result.poses, []
    for count in range(config.rounds if closures.enabled or closures.revisits else 0):
        attempts = _rematch(track, poses, matcher, closures, config)
        loops = [_closure_factor(attempt, kernel) for attempt in attempts if attempt.accepted]
        result = optimize([*chain, *loops], poses, _BATCH)
        move = _largest_move(poses, result.poses)
        poses = result.poses
        rounds.append(Round(closures=len(loops), error=result.error_after, largest_move=move))
        if progress is not None:
            progress(count + 1)
        if move < config.tolerance:
            break
    return Finished(poses=poses, factors=[*chain, *loops], attempts=attempts, rounds=rounds)


_BATCH = BatchConfig(max_iterations=30, relative_tolerance=1e-6, absolute_tolerance=1e-4)


def _rematch(
    track: Track, poses: NDArray[np.float64], matcher: Matcher, closures: LoopClosureConfig, config: FinishConfig
) -> list[Attempt]:
    """Match key scans against every earlier pass around them, close to where the optimum puts them."""
    closer = LoopCloser(matcher, track, replace(closures, max_passes=config.max_passes))
    deviations = np.array([config.search_distance, config.search_distance, config.search_angle])
    candidates = [
        candidate for key in _spaced_keys(track, config) for candidate in closer.neighbours(key, poses, deviations)
    ]
    # By reference, so that each is built once; then back into the order of the path.
    attempts = [closer.match(candidate, poses) for candidate in sorted(candidates, key=lambda c: c.key_old)]
    return sorted(attempts, key=lambda attempt: (attempt.key_new, attempt.key_old))


def _spaced_keys(track: Track, config: FinishConfig) -> list[int]:
    since, keys = np.zeros(2), []
    for key in range(1, len(track.keys)):
        since += (track.keys[key].motion.distance, track.keys[key].motion.turn)
        if since[0] >= config.spacing or since[1] >= config.spacing_angle:
            since[:] = 0.0
            keys.append(key)
    return keys


def _closure_factor(attempt: Attempt, kernel: RobustKernel) -> Factor:
    assert attempt.match is not None
    return Factor(
        kind="closure",
        i=attempt.key_old,
        j=attempt.key_new,
        T_i_j=attempt.match.T_ref_cur,
        covariance=attempt.match.covariance,
        kernel=kernel,
    )


def _largest_move(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    return float(np.hypot(*between(before, after)[:, :2].T).max())
