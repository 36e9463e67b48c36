"""The other place that a key scan fits about as well as where a loop closure puts it."""

from dataclasses import dataclass

import numpy as np

from graph.se2 import between
from iceg.slam.agreement import Tolerance, is_small
from iceg.slam.closures.attempt import Attempt


@dataclass(frozen=True, slots=True, kw_only=True)
class Rival:
    """The best of the other places that a wide search found.

    Attributes:
        misfit: of the other place, see `Place` …
        own: … and of the one that the closure says, by the same search.
        apart: how far one is from the other [m].
    """

    misfit: float
    own: float
    apart: float


def best_rival(attempt: Attempt, one_place: Tolerance) -> Rival | None:
    """The other place that a closure's later key scan fits best; None where no search found one."""
    if attempt.match is None:
        return None
    T_match_place = [between(attempt.match.T_ref_cur, place.T_old_new) for place in attempt.places]
    own = [p.misfit for p, T in zip(attempt.places, T_match_place, strict=True) if is_small(T, one_place)]
    others = [
        (p.misfit, float(np.hypot(T[0], T[1])))
        for p, T in zip(attempt.places, T_match_place, strict=True)
        if not is_small(T, one_place)
    ]
    if not own or not others:
        return None
    misfit, apart = min(others)
    return Rival(misfit=misfit, own=min(own), apart=apart)
