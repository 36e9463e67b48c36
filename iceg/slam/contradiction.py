"""How probable it makes a place that what is seen there agrees with it or contradicts it."""

from dataclasses import dataclass
from math import lgamma

from graph.ranges import RATES, between, positive
from iceg.slam.checked_settings import SlamSettings


@dataclass(frozen=True, kw_only=True)
class ContradictionConfig(SlamSettings, prefix="contradiction: "):
    """What share of the observations contradicts a place, one that is right and one that is not.

    Observations near each other err together, and places are alike to a different degree: either share is beta
    distributed, so that even a hundred that agree tell a finite amount.
    """

    right: float = between(0.03, *RATES)
    """Share that contradicts a place that is right, in the mean."""
    right_strength: float = positive(15.0)
    """So many observations tell as much about that share as is known beforehand (beta-binomial distribution)."""
    wrong: float = between(0.33, *RATES)
    """Share that contradicts one that is wrong, in the mean."""
    wrong_strength: float = positive(3.0)
    """So many observations tell as much about that share as is known beforehand: some places are alike all over."""

    def log_odds(self, agreeing: int, against: int) -> float:
        """How much more probable such counts are at the right place than at a wrong one, the logarithm.

        Args:
            agreeing: observations that agree …
            against: … and that contradict.
        """
        right = _log_probability(agreeing, against, self.right, self.right_strength)
        return right - _log_probability(agreeing, against, self.wrong, self.wrong_strength)


def _log_probability(agreeing: int, against: int, share: float, strength: float) -> float:
    """Of these observations in their order, if the share that contradicts is beta distributed."""
    a, b = share * strength, (1.0 - share) * strength
    return _log_beta(a + against, b + agreeing) - _log_beta(a, b)


def _log_beta(a: float, b: float) -> float:
    """The logarithm of the beta function."""
    return lgamma(a) + lgamma(b) - lgamma(a + b)
