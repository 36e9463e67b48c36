"""The axis that curves along a run share: time since the start."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from iceg.show.drawn_run import duration

_MINUTES_FROM = 600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeAxis:
    """Where each scan stands along a run.

    Attributes:
        of_scans: (n,) never falling: file order is time order, whatever the stamps do.
        label: with its unit.
    """

    of_scans: NDArray[np.float64]
    label: str

    @classmethod
    def of(cls, stamps: NDArray[np.float64]) -> "TimeAxis":
        """Of scans stamped in seconds; their number counts where the log has no time."""
        seconds = duration(stamps)
        if seconds is None:
            return cls(of_scans=np.arange(len(stamps), dtype=np.float64), label="scan")
        unit, name = (60.0, "min") if seconds >= _MINUTES_FROM else (1.0, "s")
        return cls(of_scans=(np.maximum.accumulate(stamps) - stamps[0]) / unit, label=f"time [{name}]")


def tidy(ax: Axes) -> None:
    """A fine grid, and no frame where there is no axis."""
    ax.grid(alpha=0.3)
    ax.margins(x=0)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
