"""What becomes of a closure by hand once the graph has settled: for the record, and for the person."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.factors import Factor
from iceg.corrections.by_hand import ByHand
from iceg.corrections.settled import Contradiction, Settled, contradiction
from iceg.slam.closures.attempt import Verdict
from iceg.slam.closures.closure import Closure
from iceg.slam.config import FinishConfig
from iceg.slam.run_warning import RunWarning
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A closure by hand, and what the rest of the graph says of it.

    Attributes:
        by_hand: the closure.
        conflict: what it contradicts; None where it agrees with the rest, or there is no factor.
        is_lost: whether its kernel takes it for an outlier.
        is_consistent: whether no other closure stands against it, and the path follows it.
    """

    by_hand: ByHand
    conflict: Contradiction | None
    is_lost: bool
    is_consistent: bool

    @classmethod
    def of(cls, by_hand: ByHand, here: Settled, poses: NDArray[np.float64], config: FinishConfig) -> "Judged":
        """What the graph says.

        Args:
            by_hand: the closure.
            here: the optimum with it.
            poses: (k, 3) of the graph without it.
            config: which closures are outliers, and from where on it is told that the path is bent.
        """
        factor = by_hand.factor
        if factor is None:
            return cls(by_hand=by_hand, conflict=None, is_lost=False, is_consistent=False)
        conflict, weight = contradiction(here, factor, poses, config), here.weight_of(factor)
        is_robust = factor.kernel is not None
        is_followed = is_robust and weight >= 1.0
        return cls(
            by_hand=by_hand,
            conflict=conflict,
            is_lost=is_robust and weight < config.outlier_weight,
            is_consistent=conflict is None or (not conflict.closures and is_followed),
        )

    @property
    def factor(self) -> Factor | None:
        """Of the graph; None where there can be none."""
        return self.by_hand.factor

    def record(self, track: Track) -> Closure:
        """For the record of closures."""
        if self.factor is None:
            return self.by_hand.record(Verdict.REJECTED, track)
        if self.conflict is None:
            return self.by_hand.record(Verdict.ACCEPTED, track)
        told = replace(self.by_hand, reason=f"{self.by_hand.reason}; {self.conflict.sentence}")
        return told.record(Verdict.REMOVED if self.is_lost else Verdict.ACCEPTED, track)

    def warning(self) -> RunWarning | None:
        """What a person should know; None where it agrees with the rest."""
        closure = self.by_hand.closure
        if self.factor is None:
            what = f"takes no part: {self.by_hand.reason}"
        elif self.conflict is None:
            return None
        else:
            what = f"is inconsistent: {self.conflict.sentence}"
            if closure.pinned:
                what += "; it is believed all the same, for it is pinned"
            elif self.is_lost:
                what += "; it takes no part unless it is pinned"
        sentence = f"{closure.where}: the closure by hand between scans {closure.scan_i} and {closure.scan_j} {what}"
        return RunWarning(kind="corrections", sentence=sentence, scan=closure.scan_i)
