"""Steps over several key scans, for matches to one local map do not add up their errors.

Two matches to the same local map place their key scans with an error each; the step between them errs by the difference
of the two. The next step begins where this one ends: its error has the same part with the other sign, and along the
path nearly all cancels but what the local map itself drifts by. A graph, which takes the errors of successive steps for
independent, would let them grow with the square root of the number of steps. So where one local map carried the robot
along, the graph is told now and then what the matches say of the whole stretch.
"""

import numpy as np

from graph.measurement import NoMatch, RelativePose
from graph.se2 import adjoint, between, chain_covariance, compose, inverse
from iceg.slam.match_errors import OWN
from iceg.slam.track import KeyScan, Track

LONG_STEP = 6
"""Key scans from one to the next."""


def long_step(track: Track, key: int) -> RelativePose | None:
    """What the matches say of the way from `LONG_STEP` key scans before to `key`.

    Args:
        track: what the front end found.
        key: index of the key scan at its end.

    Returns:
        The step, with the covariance it would have if the errors of its ends were its own and only drift were shared;
        None where a match is missing, weak, or hangs on another than the key scan before it.
    """
    first = key - LONG_STEP
    if first < 0:
        return None
    steps = [_step(track, k) for k in range(first + 1, key + 1)]
    start = None if first == 0 else _step(track, first)
    if any(step is None for step in steps) or (first > 0 and start is None):
        return None
    known = [step for step in steps if step is not None]
    last = known[-1]
    T_first_key = between(track.keys[first].T_track_robot, compose(track.keys[key - 1].T_track_robot, last.T_ref_cur))
    covariances = np.array([step.covariance for step in known])
    drift = chain_covariance(np.array([step.T_ref_cur for step in known]), covariances)
    covariance = OWN * last.covariance + (1.0 - 2.0 * OWN) * drift
    if start is not None:
        carry = adjoint(inverse(T_first_key))
        covariance += OWN * carry @ start.covariance @ carry.T
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
