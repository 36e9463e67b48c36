"""Whether a closure holds along the direction that it knows least, or the scan fits as well where it slides to.

Along a corridor, straight or curved, few things hold a scan: the ends of doors that both passes saw. The scores around
the optimum tell how sharply they do, not whether they are the right ones; and where doors have opened or closed, others
lie as sharply on each other a metre on. So the scan and its neighbours are slid along the direction that the match
knows least, on the arc about the corridor's centre where it is curved, and what agrees here is compared with what
agrees there. A closure that does not stand out leaves the direction open.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graph.measurement import RelativePose
from graph.se2 import compose, expmap
from iceg.ice.verification import Agreement

_KNOWN_WORSE = 4.0
"""A direction is asked about whose standard deviation is so many times that of the next [m, rad]."""
_AWAY = np.linspace(0.3, 2.0, 18)
_SLIDES = np.concatenate([-_AWAY[::-1], _AWAY])
"""How far the scan is slid [m]: no nearer than what holds one is wide, a door's frame."""
_LEVER = 3.0
"""Distance at which a turn counts as a slide [m]."""
_STANDS_OUT = 0.01
"""Share by which more must agree where the closure puts the scan than anywhere it slides to."""
_OPEN = 1.0
"""Standard deviation of a direction that is left open [m], as of those that a match leaves open."""


def with_open_slide(
    match: RelativePose, support: Agreement, supports_at: Callable[[NDArray[np.float64]], list[Agreement]]
) -> RelativePose:
    """A closure's match, weak along the direction that it knows least unless it stands out there.

    Args:
        match: of a key scan to an earlier pass.
        support: what agrees with the pass where the match puts the scan.
        supports_at: what agrees where each of (n, 3) other poses puts it.

    Returns:
        The match as it is, or with one more weak direction.
    """
    direction = _least_known(match)
    if direction is None:
        return match
    reach = np.sqrt(direction[0] ** 2 + direction[1] ** 2 + (_LEVER * direction[2]) ** 2)
    slid = compose(match.T_ref_cur, expmap(_SLIDES[:, None] * direction / reach))
    here = _agreeing(support)
    if here - max(map(_agreeing, supports_at(slid))) >= _STANDS_OUT * here:
        return match
    return replace(
        match,
        covariance=match.covariance + _OPEN**2 * np.outer(direction, direction),
        weak_directions=np.vstack([match.weak_directions, direction]),
    )


def _least_known(match: RelativePose) -> NDArray[np.float64] | None:
    """(3,) unit vector of the direction that a match knows far worse than the others, None if it has none."""
    if not match.is_fully_observed:
        return None
    variances, directions = np.linalg.eigh(match.covariance)
    if variances[2] < _KNOWN_WORSE**2 * variances[1]:
        return None
    return np.asarray(directions[:, 2], dtype=np.float64)


def _agreeing(support: Agreement) -> int:
    """Points on the reference, and surfels seen, less those looked through."""
    return support.inliers + support.seen - support.contradicted
