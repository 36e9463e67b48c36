"""The offline finish: optimise all factors at once, match again between optimised neighbours, until nothing moves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frontends.matcher import Matcher
from graph.batch import BatchConfig, optimize
from graph.factors import Factor, RobustKernel
from graph.se2 import between
from iceg.slam.config import FinishConfig, LoopClosureConfig
from iceg.slam.loop_closure import Attempt, LoopCloser, say_the_same
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
    kept: Sequence[Factor] = (),
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
        kept: those of the factors that are closures beyond doubt, as those added by hand.

    Returns:
        The final poses and factors.
    """
    kernel = RobustKernel(name="dcs", width=config.kernel_width)
    closer = LoopCloser(matcher, track, replace(closures, max_passes=config.max_passes))
    chain = [factor for factor in factors if factor.kind != "closure" or factor in kept]
    doubtful = [factor for factor in factors if factor.kind == "closure" and factor not in kept]
    loops = [replace(factor, kernel=kernel) for factor in doubtful]
    poses, rounds = _solve([*chain, *loops], poses, [], len(loops))
    attempts: list[Attempt] = []
    for count in range(config.rounds if closures.enabled or closures.revisits else 0):
        attempts = _rematch(closer, track, poses, config)
        loops = [_closure_factor(attempt, kernel) for attempt in attempts if attempt.accepted]
        found = _second_look(closer, attempts, poses, closures, config)
        if found:
            # Without a kernel first: they are far off, and a robust kernel would let the graph ignore them.
            pull = [_closure_factor(attempt, None) for attempt in found]
            poses, rounds = _solve([*chain, *loops, *pull], poses, rounds, len(loops) + len(pull))
            attempts = _rematch(closer, track, poses, config)
            loops = [_closure_factor(attempt, kernel) for attempt in attempts if attempt.accepted]
        poses, rounds = _solve([*chain, *loops], poses, rounds, len(loops))
        if progress is not None:
            progress(count + 1)
        if rounds[-1].largest_move < config.tolerance:
            break
    return Finished(poses=poses, factors=[*chain, *loops], attempts=attempts, rounds=rounds)


_ELSEWHERE_DISTANCE, _ELSEWHERE_TURN = 0.25, 0.08
_AROUND = (-4, -2, 0, 2, 4)
"""Key scans around a doubtful one that are searched, too."""
_BATCH = BatchConfig(max_iterations=50, relative_tolerance=1e-6, absolute_tolerance=1e-4)


def _solve(
    factors: list[Factor], poses: NDArray[np.float64], rounds: list[Round], n_closures: int
) -> tuple[NDArray[np.float64], list[Round]]:
    result = optimize(factors, poses, _BATCH)
    move = float(np.hypot(*between(poses, result.poses)[:, :2].T).max())
    done = Round(closures=n_closures, error=result.error_after, largest_move=move)
    return result.poses, [*rounds, done]


def _rematch(closer: LoopCloser, track: Track, poses: NDArray[np.float64], config: FinishConfig) -> list[Attempt]:
    """Match key scans against every earlier pass around them, close to where the optimum puts them."""
    deviations = np.array([config.search_distance, config.search_distance, config.search_angle])
    candidates = [
        candidate for key in _spaced_keys(track, config) for candidate in closer.neighbours(key, poses, deviations)
    ]
    # By reference, so that each is built once; then back into the order of the path.
    attempts = [closer.match(candidate, poses) for candidate in sorted(candidates, key=lambda c: c.key_old)]
    return sorted(attempts, key=lambda attempt: (attempt.key_new, attempt.key_old))


def _second_look(
    closer: LoopCloser,
    attempts: list[Attempt],
    poses: NDArray[np.float64],
    closures: LoopClosureConfig,
    config: FinishConfig,
) -> list[Attempt]:
    """Where two passes lie on each other and contradict each other: search wider, believe what several say."""
    if not closures.enabled:
        return []
    deviations = np.array([config.doubt_distance, config.doubt_distance, config.doubt_angle])
    doubtful = [a for a in attempts if not a.accepted and a.overlap >= config.doubt_overlap]
    pairs = sorted({(a.key_old, a.key_new + step) for a in doubtful for step in _AROUND})
    pairs = [(old, new) for old, new in pairs if old < new < len(poses)]
    pairs = pairs[:: max(1, -(-len(pairs) // config.doubts))]
    candidates = [closer.candidate(old, new, poses, deviations) for old, new in pairs]
    wide = [closer.match(candidate, poses) for candidate in candidates]
    accepted = [attempt for attempt in wide if attempt.accepted and _is_elsewhere(attempt, poses)]
    return [
        attempt
        for attempt in accepted
        if sum(say_the_same(attempt, other, poses) for other in accepted) + 1 >= closures.confirmations
    ]


def _is_elsewhere(attempt: Attempt, poses: NDArray[np.float64]) -> bool:
    """Whether a closure would move the passes against each other, not only confirm how they lie."""
    assert attempt.match is not None
    x, y, turn = between(between(poses[attempt.key_old], poses[attempt.key_new]), attempt.match.T_ref_cur).tolist()
    return bool(x * x + y * y > _ELSEWHERE_DISTANCE**2 or abs(turn) > _ELSEWHERE_TURN)


def _spaced_keys(track: Track, config: FinishConfig) -> list[int]:
    since, keys = np.zeros(2), []
    for key in range(1, len(track.keys)):
        since += (track.keys[key].motion.distance, track.keys[key].motion.turn)
        if since[0] >= config.spacing or since[1] >= config.spacing_angle:
            since[:] = 0.0
            keys.append(key)
    return keys


def _closure_factor(attempt: Attempt, kernel: RobustKernel | None) -> Factor:
    assert attempt.match is not None
    return Factor(
        kind="closure",
        i=attempt.key_old,
        j=attempt.key_new,
        T_i_j=attempt.match.T_ref_cur,
        covariance=attempt.match.covariance,
        kernel=kernel,
    )
