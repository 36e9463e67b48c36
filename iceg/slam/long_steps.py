"""Steps over several key scans, for matches to one local map do not add up their errors.

Two matches to the same local map place their key scans with an error each; the step between them errs by the difference
of the two. The next step begins where this one ends: its error has the same part with the other sign, and along the
path nearly all cancels but what the local map itself drifts by. A graph, which takes the errors of successive steps for
independent, would let them grow with the square root of the number of steps. So where one local map carried the robot
along, the graph is told now and then what the matches say of the whole stretch.
"""

import numpy as np
from numpy.typing import NDArray

from graph.dense import congruence
from graph.measurement import NoMatch, RelativePose
from graph.se2 import adjoint, between, chain_covariance, compose, inverse
from iceg.slam.tracking.match_errors import OWN
from iceg.slam.tracking.track import KeyScan, Track

LONG_STEP = 6
"""Key scans from one to the next."""


def long_steps(track: Track) -> dict[int, RelativePose]:
    """What the matches say of the way from one key scan to that `LONG_STEP` farther on, by the index of the latter.

    Args:
        track: what the front end found.

    Returns:
        Each step with the covariance it would have if the errors of its ends were its own and only drift were shared;
        none where a match is missing, weak, or hangs on another than the key scan before it.
    """
    known = [_step(track, key) for key in range(len(track.keys))]
    ends = [
        key
        for key in range(LONG_STEP, len(known), LONG_STEP)
        if all(step is not None for step in known[max(1, key - LONG_STEP) : key + 1])
    ]
    if not ends:
        return {}
    chains = [[step for step in known[key - LONG_STEP + 1 : key + 1] if step is not None] for key in ends]
    T_chains = np.array([[step.T_ref_cur for step in chain] for chain in chains])
    drifts = chain_covariance(T_chains, np.array([[step.covariance for step in chain] for chain in chains]))
    return {
        key: _long_step(track, key, chain[-1], known[key - LONG_STEP], drift)
        for key, chain, drift in zip(ends, chains, drifts, strict=True)
    }


def _long_step(
    track: Track, key: int, last: RelativePose, start: RelativePose | None, drift: NDArray[np.float64]
) -> RelativePose:
    """The step to `key`: the errors of the matches at its ends, and the drift of all its steps."""
    T_track_first = track.keys[key - LONG_STEP].T_track_robot
    T_first_key = between(T_track_first, compose(track.keys[key - 1].T_track_robot, last.T_ref_cur))
    covariance = OWN * last.covariance + (1.0 - 2.0 * OWN) * drift
    if start is not None:
        carry = adjoint(inverse(T_first_key))
        covariance += OWN * congruence(carry, start.covariance)
    return RelativePose(
        T_ref_cur=T_first_key,
        covariance=0.5 * (covariance + covariance.T),
        score=last.score,
        inliers=last.inliers,
        overlap=last.overlap,
        weak_directions=last.weak_directions,
    )


def _step(track: Track, key: int) -> RelativePose | None:
    """The match of a key scan as a step from the one before it, if it is one and sees every direction."""
    scan: KeyScan = track.keys[key]
    if isinstance(scan.match, NoMatch) or scan.anchor != key - 1 or not scan.match.is_fully_observed:
        return None
    return scan.match
