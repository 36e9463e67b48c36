"""How probable it makes a place that what is seen there agrees with it or contradicts it."""

from dataclasses import dataclass
from math import exp, lgamma, log, log1p

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

    def log_odds(self, agreeing: int, against: int, unrelated: float = 0.0) -> float:
        """How much more probable such counts are at the right place than at a wrong one, the logarithm.

        Args:
            agreeing: observations that agree …
            against: … and that contradict.
            unrelated: probability that they tell nothing of the place: any share is as probable then at either.
        """
        right = _log_probability(agreeing, against, self.right, self.right_strength)
        wrong = _log_probability(agreeing, against, self.wrong, self.wrong_strength)
        if unrelated > 0.0:
            anyhow = log(unrelated) + _log_probability(agreeing, against, 0.5, 2.0)  # a share distributed uniformly
            right, wrong = (_log_sum(log1p(-unrelated) + related, anyhow) for related in (right, wrong))
        return right - wrong


def _log_probability(agreeing: int, against: int, share: float, strength: float) -> float:
    """Of these observations in their order, if the share that contradicts is beta distributed."""
    a, b = share * strength, (1.0 - share) * strength
    return _log_beta(a + against, b + agreeing) - _log_beta(a, b)


def _log_sum(a: float, b: float) -> float:
    """The logarithm of the sum of two probabilities, given theirs."""
    most = max(a, b)
    return most + log(exp(a - most) + exp(b - most))


def _log_beta(a: float, b: float) -> float:
    """The logarithm of the beta function."""
    return lgamma(a) + lgamma(b) - lgamma(a + b)
