"""The factors at the end of a run: as the graph was solved, as they are believed, and as the poses fit them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.factors import Factor
from graph.se2 import between, compose, inverse
from iceg.slam.broken_path.path_break import Break, let_go
from iceg.slam.tracking.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class FinalFactors:
    """The factors in force, in three versions and one order.

    Attributes:
        solved: those of which the key poses are the optimum until poses and map are refined together. Odometry still
            holds in their place the parts of the path that nothing else ties.
        measured: the same measurements with the covariances in which one may believe: across a sudden loss that nothing
            joins odometry tells nothing. The covariances of the poses rest on them, and a truth judges them.
        carried: the measured ones, moved along with the poses by the joint refinement, so that the final poses are
            their optimum. They are what a run saves; without joint refinement the measured ones themselves.
    """

    solved: list[Factor]
    measured: list[Factor]
    carried: list[Factor]

    @classmethod
    def of(cls, solved: Sequence[Factor], breaks: Sequence[Break], track: Track) -> "FinalFactors":
        """All three before any joint refinement, from the solved ones and where the path is broken."""
        measured = let_go(solved, breaks, track)
        return cls(solved=list(solved), measured=measured, carried=measured)

    @property
    def are_all_believed(self) -> bool:
        """Whether each is believed as it was solved."""
        return self.measured == self.solved

    def moved(self, before: NDArray[np.float64], after: NDArray[np.float64]) -> "FinalFactors":
        """The same, carried along while the key poses moved.

        Args:
            before: (k, 3) T_map_robot of the key poses, the optimum of the solved factors.
            after: (k, 3) the same poses refined.

        Returns:
            The carried factors have the residuals at the new poses that the measured ones have at the old ones.
        """
        # A prior, which has no first pose, stays as it is.
        i = np.array([factor.j if factor.i is None else factor.i for factor in self.measured])
        j = np.array([factor.j for factor in self.measured])
        corrections = compose(between(after[i], after[j]), inverse(between(before[i], before[j])))
        T_i_j = compose(corrections, np.array([factor.T_i_j for factor in self.measured]))
        carried = [
            factor if factor.i is None else factor.measuring(T) for factor, T in zip(self.measured, T_i_j, strict=True)
        ]
        return replace(self, carried=carried)
