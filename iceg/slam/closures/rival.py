"""The other place that a key scan fits about as well as where a loop closure puts it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graph.se2 import between
from iceg.slam.closures.attempt import Attempt

_SAME_PLACE, _SAME_TURN = 0.5, 0.1
"""Places of one key scan no farther apart than this are one [m, rad]."""


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


def best_rival(attempt: Attempt) -> Rival | None:
    """The other place that a closure's later key scan fits best; None where no search found one."""
    if attempt.match is None:
        return None
    T_match_place = [between(attempt.match.T_ref_cur, place.T_old_new) for place in attempt.places]
    own = [p.misfit for p, T in zip(attempt.places, T_match_place, strict=True) if is_one_place(T)]
    others = [
        (p.misfit, float(np.hypot(T[0], T[1])))
        for p, T in zip(attempt.places, T_match_place, strict=True)
        if not is_one_place(T)
    ]
    if not own or not others:
        return None
    misfit, apart = min(others)
    return Rival(misfit=misfit, own=min(own), apart=apart)


def is_one_place(T_a_b: NDArray[np.float64]) -> bool:
    """Whether two poses of one key scan, (3,) one in the frame of the other, are the same place."""
    x, y, turn = T_a_b.tolist()
    return bool(x * x + y * y < _SAME_PLACE**2 and abs(turn) < _SAME_TURN)
