"""How far a run has come, as it tells whoever watches."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Stage = Literal["matching", "graph", "finish", "filtering"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Where a run stands.

    Attributes:
        scans: scans processed so far.
        tried: matches tried so far.
        accepted: matches that found something credible.
        stage: what is being done: "matching", "graph" or "finish"; "filtering" in DP-SLAM.
    """

    scans: int
    tried: int
    accepted: int
    stage: Stage = "matching"


ProgressCallback = Callable[[Progress], None]
