"""What studies of runs and matchers show: closures by scan, time per scan, success over the start."""

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from iceg.plot.time_axis import tidy
from iceg.show.drawn_run import drawn_run
from iceg.show.map_image import CLOSURE_COLOUR

if TYPE_CHECKING:
    from matplotlib.image import AxesImage

    from iceg.evaluation.basin import Basin
    from iceg.run_folder import RunFolder
    from iceg.run_result.slam_result import SlamResult

_VERDICTS = (("rejected", "#bbbbbb", 5), ("removed", "#c1272d", 12), ("accepted", CLOSURE_COLOUR, 9))
_MEAN, _MEDIAN = "#3b3b98", "#f4a259"
_WINDOWS = 60


def closures(run: "SlamResult | RunFolder", ax: Axes) -> None:
    """Draw which scan was tied to which, by verdict.

    Args:
        run: the run.
        ax: axes to draw on.
    """
    drawn = drawn_run(run)
    for verdict, colour, size in _VERDICTS:
        chosen = [(found.scan_j, found.scan_i) for found in drawn.closures if found.verdict == verdict]
        scans = np.array(chosen, dtype=np.int64).reshape(-1, 2)
        ax.scatter(scans[:, 0], scans[:, 1], s=size, color=colour, label=f"{verdict} ({len(scans)})")
    n = len(drawn.trajectory)
    ax.plot([0, n], [0, n], color="#999999", linewidth=0.6)
    ax.set(xlabel="scan", ylabel="earlier scan it was matched to", title="closures", aspect="equal")
    ax.legend(loc="upper left", fontsize="small", frameon=False)


def scan_times(seconds: NDArray[np.float64], ax: Axes) -> None:
    """Draw what each scan took, as mean and median of many in a row.

    Args:
        seconds: (n,) of each scan, n ≥ 1.
        ax: axes to draw on.
    """
    window = max(1, len(seconds) // _WINDOWS)
    parts = np.array_split(1000 * seconds, len(seconds) // window)
    places = np.cumsum([len(part) for part in parts])
    ax.plot(places, [part.mean() for part in parts], color=_MEAN, label=f"mean of {window} scans")
    ax.plot(places, [np.median(part) for part in parts], color=_MEDIAN, label="median")
    ax.set(xlabel="scan", ylabel="time of a scan in the front end [ms]", ylim=(0, None), title="time per scan")
    tidy(ax)
    ax.legend(fontsize="small", frameon=False)


def success(basin: "Basin", ax: Axes) -> "AxesImage":
    """Draw the share of matches that succeeded over how far off they started.

    Args:
        basin: the shares.
        ax: axes to draw on.

    Returns:
        The picture, for a colour bar.
    """
    image = ax.imshow(100 * basin.success, origin="lower", vmin=0, vmax=100, cmap="viridis", aspect="auto")
    for (row, column), share in np.ndenumerate(basin.success):
        colour = "black" if share > 0.6 else "white"
        ax.text(column, row, f"{100 * share:.0f}", ha="center", va="center", fontsize=7, color=colour)
    turns = [f"{math.degrees(turn):.0f}" for turn in basin.rotations.tolist()]
    ax.set_xticks(range(len(turns)), turns, fontsize=7)
    ax.set_yticks(range(len(basin.translations)), [f"{metres:g}" for metres in basin.translations.tolist()], fontsize=7)
    return image
