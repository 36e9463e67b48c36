"""The factors at the end of a run: as the graph was solved, and as they are believed."""

from collections.abc import Sequence
from dataclasses import dataclass

from graph.factors import Factor
from iceg.slam.broken_path.path_break import Break, without_lost_steps


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
