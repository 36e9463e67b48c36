"""Matching again between optimised poses: passes that no closure ties yet, closures in doubt, and what they hide.

A closure that the optimum agrees with is not matched again: it would say the same. Nor is a pass that such a closure
ties, a few key poses away: the joint refinement holds them together better than another match would.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graph.factors import Factor
from graph.se2 import between
from iceg.slam.back_end import KNOWN_SPACING
from iceg.slam.closures.attempt import Attempt, say_the_same
from iceg.slam.closures.candidates import Candidate
from iceg.slam.config import FinishConfig
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.tracking.track import Track

_ELSEWHERE_DISTANCE, _ELSEWHERE_TURN = 0.25, 0.08
"""A match farther than this from the estimate contradicts it [m, rad]."""
_AROUND = (-4, -2, 0, 2, 4)
"""Key scans around a doubtful one that are searched, too …"""
_AROUND_FIRST = (-2, 0, 2)
"""… once these have found something: where three of five say the same, one of these is among them."""


def match_again(
    closer: LoopCloser,
    track: Track,
    poses: NDArray[np.float64],
    sure: Sequence[Factor],
    doubtful: Sequence[Factor],
    config: FinishConfig,
) -> list[Attempt]:
    """Match key scans against earlier passes that no sure closure ties, close to where the optimum puts them.

    Args:
        closer: matches and verifies.
        track: key scans.
        poses: (k, 3) the optimum.
        sure: closures that agree with it.
        doubtful: those that do not, which are tried again.
        config: how densely, and how far around.

    Returns:
        What was tried, in the order of the path.
    """
    deviations = np.array([config.search_distance, config.search_distance, config.search_angle])
    again = [Candidate.of(factor.i, factor.j, poses, deviations) for factor in doubtful if factor.i is not None]
    known = {(candidate.key_old, candidate.key_new) for candidate in again}
    around = [
        candidate
        for key in _spaced_keys(track, config, closer.offered)
        for candidate in closer.neighbours(key, poses, deviations)
        if (candidate.key_old, candidate.key_new) not in known
    ]
    attempts = [closer.match(candidate, poses) for candidate in again]
    ties = _Ties(max(1, closer.config.reference_half))
    for i, j in [(factor.i, factor.j) for factor in sure] + [(a.key_old, a.key_new) for a in attempts if a.accepted]:
        ties.add(i or 0, j)
    # By reference, so that each is built once; then back into the order of the path.
    for candidate in sorted(around, key=lambda c: c.key_old):
        if not ties.join(candidate.key_old, candidate.key_new):
            attempts.append(closer.match(candidate, poses))
            if attempts[-1].accepted:
                ties.add(candidate.key_old, candidate.key_new)
    return sorted(attempts, key=lambda attempt: (attempt.key_new, attempt.key_old))


class _Ties:
    """Which passes closures tie, to within some key poses at both ends."""

    def __init__(self, within: int) -> None:
        self._within = within
        self._at: dict[tuple[int, int], list[tuple[int, int]]] = {}

    def add(self, i: int, j: int) -> None:
        self._at.setdefault((i // self._within, j // self._within), []).append((i, j))

    def join(self, i: int, j: int) -> bool:
        reach = self._within
        return any(
            abs(i - other_i) <= reach and abs(j - other_j) <= reach
            for a in range(i // reach - 1, i // reach + 2)
            for b in range(j // reach - 1, j // reach + 2)
            for other_i, other_j in self._at.get((a, b), ())
        )


def second_look(
    closer: LoopCloser,
    attempts: list[Attempt],
    poses: NDArray[np.float64],
    config: FinishConfig,
) -> list[Attempt]:
    """Where two passes lie on each other and contradict each other: search wider, believe what several say.

    Args:
        closer: matches and verifies.
        attempts: those of the last round.
        poses: (k, 3) T_map_robot of the key poses.
        config: what counts as doubt, and how many are looked at.

    Returns:
        The attempts that agree with others on another place.
    """
    if not closer.config.enabled:
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
        if sum(say_the_same(attempt, other, poses) for other in accepted) + 1 >= closer.config.confirmations
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
