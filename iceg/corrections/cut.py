"""What a person cuts from a log."""

from dataclasses import dataclass

import numpy as np

from iceg.corrections.errors import CorrectionsError
from iceg.slam.kept_scans import Interval, KeptScans


@dataclass(frozen=True, kw_only=True)
class Cut:
    """What is cut from a log.

    Attributes:
        keep: only these intervals take part; all scans if there are none.
        drop: intervals that take no part.
        where: file and line it is from, for messages.
    """

    keep: tuple[Interval, ...] = ()
    drop: tuple[Interval, ...] = ()
    where: str = "a cut"

    def kept(self, n_scans: int) -> KeptScans:
        """Which of so many recorded scans are left.

        Raises:
            CorrectionsError: none are.
        """
        is_kept = np.full(n_scans, not self.keep)
        for first, last in self.keep:
            is_kept[first : last + 1] = True
        for first, last in self.drop:
            is_kept[first : last + 1] = False
        if not is_kept.any():
            raise CorrectionsError(f"{self.where}: nothing is left of {n_scans} scans, expected at least one")
        edges = np.diff(np.concatenate([[False], is_kept, [False]]).astype(np.int8))
        firsts, lasts = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        return KeptScans(recorded=n_scans, intervals=tuple(zip(firsts.tolist(), lasts.tolist(), strict=True)))
