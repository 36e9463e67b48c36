"""What the writers of exported files may be told, and what goes wrong."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from graph.errors import IcegError
from iceg.config import StampsWritten


class ExportError(IcegError):
    """Results that cannot be written in the format asked for."""


def tell_nobody(_sentence: str) -> None:
    """What a caller who wants to hear nothing passes."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """What some formats need besides the folder of a run.

    Attributes:
        log: the recorded log, for formats that hold scans.
        stamps: of trajectories: as in `trajectory.tum`, or repaired so that they increase.
        tell: told what a person should know of what was written, a sentence each.
    """

    log: Path | None = None
    stamps: StampsWritten = "recorded"
    tell: Callable[[str], None] = tell_nobody
