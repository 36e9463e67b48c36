"""What counts as good, as ruined and as said: the only place where that is decided."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

GOOD_M = 0.1
"""A run is good whose error is smaller than this [m] …"""
GOOD_SHARE = 0.02
"""… or than this share of the error of the odometry as it was recorded: a campus need not be known to a decimetre."""
RUINED_M = 0.3
"""A run that is not good and errs by more than this [m] is ruined: walls stand double, rooms lie in each other."""
RUINED_FACTOR = 5.0
"""Of a log with a fault it must also err by so many times its error without."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What became of a run.

    Attributes:
        is_good: it may be used as it is.
        is_ruined: it may not be used for anything.
        is_said: the run itself says that something is wrong with it.
    """

    is_good: bool
    is_ruined: bool
    is_said: bool

    @property
    def is_ruined_and_said(self) -> bool:
        """Ruined, but a person is warned."""
        return self.is_ruined and self.is_said

    @property
    def is_ruined_in_silence(self) -> bool:
        """Ruined, and nobody would know: what must not be."""
        return self.is_ruined and not self.is_said

    @property
    def is_off_in_silence(self) -> bool:
        """Not good, ruined or not, and not a word about it."""
        return not (self.is_good or self.is_said)


def verdict(error: float, odometry_error: float, said: bool, usual: float = 0.0) -> Verdict:
    """Judge a run by its error.

    Args:
        error: of the trajectory, or of relations [m].
        odometry_error: the same of the odometry as it was recorded, before any fault [m].
        said: what `is_said` found.
        usual: error of the same log without its fault [m].
    """
    is_good = error < max(GOOD_M, GOOD_SHARE * odometry_error)
    is_ruined = not is_good and error > max(RUINED_M, RUINED_FACTOR * usual)
    return Verdict(is_good=is_good, is_ruined=is_ruined, is_said=said)


def is_said(summary: Mapping[str, Any], known: frozenset[str] = frozenset()) -> bool:
    """Whether a run says that something is wrong with it.

    That is: it was lost, its path is broken, or it warns of anything. Uncertainty is among the warnings once a standard
    deviation is that of `finish.uncertain`: a covariance alone, without a word, is not said.

    Args:
        summary: of the run, as in `summary.json`.
        known: warnings that say nothing about the result: those about the recording, and for a log with a fault those
            of the run without it.
    """
    return bool(summary["lost_at_scans"] or summary["breaks"] or not known.issuperset(summary["warnings"]))
