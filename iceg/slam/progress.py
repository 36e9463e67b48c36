"""How far a run has come, as it tells whoever watches."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Where a run stands.

    Attributes:
        scans: scans processed so far.
        tried: matches tried so far.
        accepted: matches that found something credible.
    """

    scans: int
    tried: int
    accepted: int


ProgressCallback = Callable[[Progress], None]
