"""What a match errs by: some of it is its key scan's own, the rest it shares with its neighbours.

A match places a key scan on a local map. The covariance it gives is that of the step from the key scan before, as it is
calibrated: the errors of both ends, half of it each, for what the map itself drifts by in between is next to nothing
(6 % in simulated scenes). So successive steps err against each other, and a long way hardly more than a short one.
"""

from graph.arrays import Floats
from graph.dense import inv
from graph.measurement import NoMatch, RelativePose
from graph.se2 import compose_covariance
from iceg.slam.track import KeyScan, Track


def placement_covariance(track: Track, key: int) -> Floats:
    """How far a key scan lies off the local map around it.

    Args:
        track: what the front end found.
        key: index of the key scan; the first, which was matched to nothing, is known as well as the second.

    Returns:
        (3, 3) tangent space at it; odometry limits it where its match is weak or missing.
    """
    scan: KeyScan = track.keys[min(max(key, 1), len(track.keys) - 1)]
    if isinstance(scan.match, NoMatch):
        return scan.motion.covariance
    information = inv(scan.match.covariance) + inv(scan.motion.covariance)
    return 0.5 * inv(information)


def closure_covariance(match: RelativePose, placement: Floats, scale: float = 1.0) -> Floats:
    """Covariance of a match to an earlier pass as a factor between two key poses.

    The match says how a scan lies to the pass as a whole. How far the key pose that the pass hangs on is itself off the
    others adds to it, and the more the farther the two key poses are apart: an error of its heading has a lever.

    Args:
        match: of the later key scan, in the frame of the earlier one.
        placement: (3, 3) of the earlier one (`placement_covariance`).
        scale: factor of the variances of the match (`Track.match_covariance_scale`).

    Returns:
        (3, 3) tangent space at the match.
    """
    return compose_covariance(placement, match.T_ref_cur, scale * match.covariance)
