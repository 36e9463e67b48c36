"""Matching again between optimised poses: passes that no closure ties yet, and closures that are outliers.

A closure that the optimum agrees with is not matched again: it would say the same. Nor is a pass that such a closure
ties, a few key poses away: the joint refinement holds them together better than another match would.
"""

from collections.abc import Sequence

import numpy as np

from graph.arrays import Bools, Floats
from graph.factors import Factor
from graph.growing_rows import GrowingRows
from iceg.slam.closures.attempt import Attempt
from iceg.slam.closures.candidates import Candidate
from iceg.slam.config import FinishConfig
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.track import Track


def match_again(
    closer: LoopCloser, poses: Floats, sure: Sequence[Factor], outliers: Sequence[Factor], config: FinishConfig
) -> list[Attempt]:
    """Match key scans against earlier passes that no sure closure ties, close to where the optimum puts them.

    Args:
        closer: matches and verifies key scans.
        poses: (k, 3) the optimum.
        sure: closures that agree with it.
        outliers: those that do not, which are tried again.
        config: how densely, and how far around.

    Returns:
        What was tried, in the order of the path.
    """
    deviations = np.array([config.search_distance, config.search_distance, config.search_angle])
    again = [Candidate.of(factor.i, factor.j, poses, deviations) for factor in outliers if factor.i is not None]
    known = {candidate.pair for candidate in again}
    around = [
        candidate
        for key in _spaced_keys(closer.track, config, closer.passes.searchable, closer.config.confirmed.spacing)
        for candidate in closer.passes.within(key, poses, deviations)
        if candidate.pair not in known
    ]
    attempts = [closer.match(candidate, poses) for candidate in again]
    reach = max(1, closer.config.reference_half)
    ties: GrowingRows[np.int64] = GrowingRows((2,), np.int64)
    for pair in [*(factor.pair for factor in sure), *(a.pair for a in attempts if a.accepted)]:
        ties.append(pair)
    # By reference, so that each is built once; then back into the order of the path.
    for candidate in sorted(around, key=lambda c: c.key_old):
        if not (np.abs(ties.rows - candidate.pair) <= reach).all(axis=1).any():
            attempts.append(closer.match(candidate, poses))
            if attempts[-1].accepted:
                ties.append(candidate.pair)
    return sorted(attempts, key=lambda attempt: (attempt.key_new, attempt.key_old))


def _spaced_keys(track: Track, config: FinishConfig, searchable: Bools, seldom: float) -> list[int]:
    """Key scans to match again: some distance apart, farther in confirmed areas."""
    since, keys = np.zeros(2), []
    for key in range(1, len(track.keys)):
        step = np.array([track.keys[key].motion.distance, track.keys[key].motion.turn])
        since += step if searchable[key] else step / seldom
        if since[0] >= config.spacing or since[1] >= config.spacing_angle:
            since[:] = 0.0
            keys.append(key)
    return keys
