"""How far a run has come, as it tells whoever watches."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, cast

Stage = Literal["matching", "sweep", "graph", "finish", "covariances", "feature_map", "grid", "filtering"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Where a run stands.

    Attributes:
        scans: scans processed so far, in the latest pass over the log.
        tried: matches tried so far.
        accepted: matches that found something credible.
        stage: what is being done, in this order; "sweep" and "finish" match again. DP-SLAM knows "filtering" only.
    """

    scans: int
    tried: int
    accepted: int
    stage: Stage = "matching"


ProgressCallback = Callable[[Progress], None]


class StageProgress:
    """Tells a caller of each stage that begins, and passes on what the stages tell; nobody need listen."""

    def __init__(self, callback: ProgressCallback | None) -> None:
        self._callback = callback
        self._latest = Progress(scans=0, tried=0, accepted=0)

    def __call__(self, progress: Progress) -> None:
        """Pass on where the stage stands that runs."""
        self._latest = replace(progress, stage=self._latest.stage)
        if self._callback is not None:
            self._callback(self._latest)

    def begin(self, stage: str) -> None:
        """Tell that a stage begins.

        Args:
            stage: as the summary of a run calls it.
        """
        self._latest = replace(self._latest, stage="matching" if stage == "front_end" else cast("Stage", stage))
        self(self._latest)
