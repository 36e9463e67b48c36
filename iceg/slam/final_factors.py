"""The factors at the end of a run: as the graph was solved, and as they are believed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from graph.factors import Factor
from iceg.slam.broken_path.path_break import Break, Outcome
from iceg.slam.track import UNKNOWN_STEP


@dataclass(frozen=True, slots=True, kw_only=True)
class FinalFactors:
    """The factors in force, in two versions and one order.

    Attributes:
        solved: those of which the key poses are the optimum until poses and map are refined together. Odometry still
            holds in their place the parts of the path that nothing else ties.
        measured: the same measurements with the covariances in which one may believe: across a sudden loss that nothing
            joins odometry tells nothing. They are what a run saves, and the covariances of the poses rest on them.
    """

    solved: list[Factor]
    measured: list[Factor]

    @classmethod
    def of(cls, solved: Sequence[Factor], breaks: Sequence[Break], min_credible: int) -> "FinalFactors":
        """Both, from the solved ones and where the path is broken; see `without_lost_steps`."""
        return cls(solved=list(solved), measured=without_lost_steps(solved, breaks, min_credible))

    @property
    def are_all_believed(self) -> bool:
        """Whether each is believed as it was solved."""
        return self.measured == self.solved


def without_lost_steps(factors: Sequence[Factor], breaks: Sequence[Break], min_credible: int) -> list[Factor]:
    """The factors of a graph, steps telling nothing where they alone hold what a sudden loss has torn apart.

    Where what the laser sees changed at once the robot may have been carried anywhere. Elsewhere it went by dead
    reckoning, and odometry tells the truth; it does, too, where scans agree with what it says, if not enough of them
    to hold the path together.

    Args:
        factors: of the graph.
        breaks: of the path; those that are apart matter.
        min_credible: so many scans that agree with odometry make it credible that the robot was not carried, even where
            as many do not.
    """
    torn = {
        found.key
        for found in breaks
        if found.outcome is Outcome.APART and found.closures < min_credible and found.is_sudden
    }
    return [
        replace(factor, covariance=UNKNOWN_STEP) if factor.kind in {"odometry", "ice"} and factor.j in torn else factor
        for factor in factors
    ]
