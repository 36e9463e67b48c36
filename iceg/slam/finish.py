"""The offline finish: all factors at once, matches again between optimised neighbours, then poses and map together."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from frontends.matcher import Matcher
from frontends.scan import Scan
from graph.batch import BatchConfig, optimize
from graph.factors import Factor, RobustKernel
from graph.se2 import between, compose, inverse
from iceg.slam.back_end import KNOWN_SPACING
from iceg.slam.closure_attempt import Attempt, say_the_same
from iceg.slam.closure_candidates import Candidate
from iceg.slam.closure_record import without_contradicted
from iceg.slam.config import FinishConfig, LoopClosureConfig
from iceg.slam.joint_refinement import JointRefinement, key_clouds, refine_jointly
from iceg.slam.loop_closure import LoopCloser
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
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """The finished graph.

    Attributes:
        poses: (k, 3) T_map_robot of the key poses.
        factors: those in force at the end.
        attempts: the closures tried in the last round, empty if none was.
        rounds: one entry for each.
        covariances: (k, 3, 3) marginal covariances of the poses, None where only the graph knows them.
    """

    poses: NDArray[np.float64]
    factors: list[Factor]
    attempts: list[Attempt]
    rounds: list[Round]
    covariances: NDArray[np.float64] | None = None


def finish(
    factors: list[Factor],
    poses: NDArray[np.float64],
    track: Track,
    matcher: Matcher,
    closures: LoopClosureConfig,
    config: FinishConfig,
    progress: Callable[[int], None] | None = None,
    kept: Sequence[Factor] = (),
    scan_of: Callable[[int], Scan] | None = None,
    offered: NDArray[np.bool_] | None = None,
    parts: Sequence[int] = (),
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
        scan_of: the scans of the log by index, so that those between key scans take part in the joint refinement.
        offered: (k,) key scans that later ones are matched against; all when left out.
        parts: key poses at which a part begins that nothing ties to what was before.

    Returns:
        The final poses and factors.
    """
    kernel = RobustKernel(name="dcs", width=config.kernel_width)
    closer = LoopCloser(matcher, track, replace(closures, max_passes=config.max_passes), parts)
    if offered is not None:
        closer.offered = offered
    chain = [factor for factor in factors if factor.kind != "closure" or factor in kept]
    doubtful = [factor for factor in factors if factor.kind == "closure" and factor not in kept]
    loops = [replace(factor, kernel=kernel) for factor in doubtful]
    clock = _Clock()
    poses, done = _solve("solve", chain, loops, poses, clock)
    rounds = [done]
    attempts: list[Attempt] = []
    for count in range(config.rounds if closures.enabled or closures.revisits else 0):
        joined = {(factor.i, factor.j) for factor in loops}
        attempts = _rematch(closer, track, poses, config)
        loops = [_closure_factor(attempt, kernel) for attempt in attempts if attempt.accepted]
        found = _second_look(closer, attempts, poses, closures, config)
        before = poses
        if found:
            # Without a kernel first: they are far off, and a robust kernel would let the graph ignore them.
            pull = [_closure_factor(attempt, None) for attempt in found]
            poses, _ = _solve("rematch", chain, [*loops, *pull], poses, clock)
            attempts = _rematch(closer, track, poses, config)
            loops = [_closure_factor(attempt, kernel) for attempt in attempts if attempt.accepted]
        poses, done = _solve("rematch", chain, loops, poses, clock)
        largest, mean = _moves(before, poses)
        fresh = sum((factor.i, factor.j) not in joined for factor in loops)
        rounds.append(replace(done, fresh=fresh, largest_move=largest, mean_move=mean))
        if progress is not None:
            progress(count + 1)
        if largest < config.tolerance:
            break
    attempts, loops = without_contradicted(attempts, loops, poses)
    factors = [*chain, *loops]
    covariances = None
    if config.joint.enabled:
        factors, refined, done = _joint(factors, poses, track, config, scan_of, parts, clock)
        poses, covariances = refined.poses, refined.covariances
        rounds.append(replace(done, closures=len(loops)))
    return Finished(poses=poses, factors=factors, attempts=attempts, rounds=rounds, covariances=covariances)


_ELSEWHERE_DISTANCE, _ELSEWHERE_TURN = 0.25, 0.08
_AROUND = (-4, -2, 0, 2, 4)
"""Key scans around a doubtful one that are searched, too …"""
_AROUND_FIRST = (-2, 0, 2)
"""… once these have found something: where three of five say the same, one of these is among them."""
_BATCH = BatchConfig(max_iterations=50, relative_tolerance=1e-6, absolute_tolerance=1e-4)


class _Clock:
    """Seconds from one stage to the next."""

    def __init__(self) -> None:
        self._last = time.perf_counter()

    def lap(self) -> float:
        last, self._last = self._last, time.perf_counter()
        return round(self._last - last, 4)


def _solve(
    stage: Stage, chain: list[Factor], loops: list[Factor], poses: NDArray[np.float64], clock: _Clock
) -> tuple[NDArray[np.float64], Round]:
    result = optimize([*chain, *loops], poses, _BATCH)
    largest, mean = _moves(poses, result.poses)
    return result.poses, Round(
        stage=stage,
        closures=len(loops),
        error_before=result.error_before,
        error=result.error_after,
        largest_move=largest,
        mean_move=mean,
        seconds=clock.lap(),
    )


def _moves(before: NDArray[np.float64], after: NDArray[np.float64]) -> tuple[float, float]:
    """Largest and mean distance [m] between two estimates of the key poses."""
    distances = np.hypot(*(after - before)[:, :2].T)
    return float(distances.max()), float(distances.mean())


def _joint(
    factors: list[Factor],
    poses: NDArray[np.float64],
    track: Track,
    config: FinishConfig,
    scan_of: Callable[[int], Scan] | None,
    parts: Sequence[int],
    clock: _Clock,
) -> tuple[list[Factor], JointRefinement, Round]:
    """Refine poses and map together; the factors go along, so that the graph's optimum is the refined trajectory."""
    refined = refine_jointly(factors, poses, key_clouds(track, scan_of, config.joint), config.joint, parts)
    carried = _carried(factors, poses, refined.poses)
    largest, mean = _moves(poses, refined.poses)
    return (
        carried,
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
            seconds=clock.lap(),
        ),
    )


def _carried(factors: list[Factor], before: NDArray[np.float64], after: NDArray[np.float64]) -> list[Factor]:
    """The factors with the residuals at the new poses that they had at the old ones."""
    # A prior, which has no first pose, stays as it is.
    i = np.array([factor.j if factor.i is None else factor.i for factor in factors])
    j = np.array([factor.j for factor in factors])
    corrections = compose(between(after[i], after[j]), inverse(between(before[i], before[j])))
    measured = compose(corrections, np.array([factor.T_i_j for factor in factors]))
    return [
        factor if factor.i is None else factor.measuring(T_i_j) for factor, T_i_j in zip(factors, measured, strict=True)
    ]


def _rematch(closer: LoopCloser, track: Track, poses: NDArray[np.float64], config: FinishConfig) -> list[Attempt]:
    """Match key scans against every earlier pass around them, close to where the optimum puts them."""
    deviations = np.array([config.search_distance, config.search_distance, config.search_angle])
    candidates = [
        candidate
        for key in _spaced_keys(track, config, closer.offered)
        for candidate in closer.neighbours(key, poses, deviations)
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
    doubtful = [a for a in attempts if not a.accepted and a.overlap >= config.doubt_overlap]
    pairs = sorted({(a.key_old, a.key_new + step) for a in doubtful for step in _AROUND})
    pairs = [(old, new) for old, new in pairs if old < new < len(poses)]
    pairs = pairs[:: max(1, -(-len(pairs) // config.doubts))]
    first = {(a.key_old, a.key_new + step) for a in doubtful for step in _AROUND_FIRST}
    accepted = _elsewhere(closer, [pair for pair in pairs if pair in first], poses, config)
    if accepted:
        accepted += _elsewhere(closer, [pair for pair in pairs if pair not in first], poses, config)
    return [
        attempt
        for attempt in accepted
        if sum(say_the_same(attempt, other, poses) for other in accepted) + 1 >= closures.confirmations
    ]


def _elsewhere(
    closer: LoopCloser, pairs: Sequence[tuple[int, int]], poses: NDArray[np.float64], config: FinishConfig
) -> list[Attempt]:
    """Closures of an earlier and a later key pose each, searched wide, that would move them against each other."""
    deviations = np.array([config.doubt_distance, config.doubt_distance, config.doubt_angle])
    wide = [closer.match(Candidate.of(old, new, poses, deviations), poses) for old, new in pairs]
    return [attempt for attempt in wide if attempt.accepted and _is_elsewhere(attempt, poses)]


def _is_elsewhere(attempt: Attempt, poses: NDArray[np.float64]) -> bool:
    """Whether a closure would move the passes against each other, not only confirm how they lie."""
    assert attempt.match is not None
    x, y, turn = between(between(poses[attempt.key_old], poses[attempt.key_new]), attempt.match.T_ref_cur).tolist()
    return bool(x * x + y * y > _ELSEWHERE_DISTANCE**2 or abs(turn) > _ELSEWHERE_TURN)


def _spaced_keys(track: Track, config: FinishConfig, offered: NDArray[np.bool_]) -> list[int]:
    """Key scans to match again: some distance apart, farther on known ground."""
    since, keys = np.zeros(2), []
    for key in range(1, len(track.keys)):
        step = np.array([track.keys[key].motion.distance, track.keys[key].motion.turn])
        since += step if offered[key] else step / KNOWN_SPACING
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
