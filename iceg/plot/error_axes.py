"""Errors along a run, and paths beside each other."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from iceg.plot.time_axis import TimeAxis, tidy
from iceg.show.map_image import INK

_CLAIMED = "#0072b2"
_PATHS = ("#0072b2", "#d1495b", "#8e3b8a", "#f4a259")
_TRUTH = "#9a9a9a"


def error_over_time(
    stamps: NDArray[np.float64],
    errors: NDArray[np.float64],
    ax: Axes,
    sigmas: NDArray[np.float64] | None = None,
    *,
    label: str = "position error [m]",
    bound: float = 3.0,
) -> None:
    """Draw an error along the trajectory against the uncertainty that was claimed for it.

    Args:
        stamps: (n,) of the poses [s].
        errors: (n,) signed or absolute error.
        ax: axes to draw on.
        sigmas: (n,) claimed standard deviation; the band of ± `bound` of them is shaded.
        label: of the vertical axis.
        bound: size of the band in standard deviations.
    """
    time = TimeAxis.of(stamps)
    if sigmas is not None:
        low = -bound * sigmas if (errors < 0).any() else np.zeros_like(sigmas)
        ax.fill_between(
            time.of_scans, low, bound * sigmas, color=_CLAIMED, alpha=0.15, linewidth=0, label=f"{bound:g} σ claimed"
        )
    ax.plot(time.of_scans, errors, color=INK, linewidth=1.0, label="error")
    ax.set(xlabel=time.label, ylabel=label)
    tidy(ax)
    ax.legend(fontsize="small", frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)


def curves(stamps: NDArray[np.float64], values: Mapping[str, NDArray[np.float64]], ax: Axes, *, label: str) -> None:
    """Draw several values over time.

    Args:
        stamps: (n,) of the scans [s].
        values: (n,) of each curve by name.
        ax: axes to draw on.
        label: of the vertical axis.
    """
    time = TimeAxis.of(stamps)
    for index, (name, value) in enumerate(values.items()):
        ax.plot(time.of_scans, value, color=_PATHS[index % len(_PATHS)], linewidth=0.8, label=name)
    ax.set(xlabel=time.label, ylabel=label)
    tidy(ax)
    ax.legend(fontsize="small", frameon=False)


def paths(poses: Mapping[str, NDArray[np.float64]], ax: Axes, *, truth: NDArray[np.float64] | None = None) -> None:
    """Draw several paths over each other.

    Args:
        poses: (n, 3) of each path by name, in one frame.
        ax: axes to draw on.
        truth: (n, 3) true poses in that frame, drawn broad below them.
    """
    if truth is not None:
        ax.plot(*truth[:, :2].T, color=_TRUTH, linewidth=2.5, label="truth")
    for index, (name, path) in enumerate(poses.items()):
        ax.plot(*path[:, :2].T, color=_PATHS[index % len(_PATHS)], linewidth=0.9, label=name)
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small", frameon=False)
