"""How sure a run is of its key poses, over time, with the closures that tie it down."""

import math
from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from graph.dense import eigvalsh
from iceg.plot.time_axis import TimeAxis, tidy
from iceg.show.drawn_run import DrawnRun, drawn_run
from iceg.show.map_image import CLOSURE_COLOUR
from iceg.slam.closures.closure import joined_scans

if TYPE_CHECKING:
    from iceg.run_folder import RunFolder
    from iceg.run_result.slam_result import SlamResult

_SIZE = (9.0, 4.6)
_WIDE, _NARROW = "#0072b2", "#7fb8d9"
_MARKS = 0.05
"""Share of the height that the marks of closures take."""


def uncertainty(run: "SlamResult | RunFolder", ax: Axes, *, of: Literal["position", "heading"] = "position") -> None:
    """Draw the standard deviations of the key poses over time; ticks below mark where a closure came in.

    Args:
        run: the run.
        ax: axes to draw on.
        of: which of them.
    """
    _draw(ax, drawn_run(run), of)


def uncertainty_figure(run: "SlamResult | RunFolder") -> Figure:
    """Position and heading, one below the other.

    Returns:
        A figure of a page's width, tied to no display.
    """
    drawn = drawn_run(run)
    figure = Figure(figsize=_SIZE, layout="constrained")
    position, heading = figure.subplots(2, 1, sharex=True)
    _draw(position, drawn, "position")
    _draw(heading, drawn, "heading")
    heading.get_legend().remove()
    position.label_outer()
    position.set_title(drawn.name, loc="left", fontsize="medium")
    figure.align_ylabels()
    return figure


def _draw(ax: Axes, run: DrawnRun, of: Literal["position", "heading"]) -> None:
    time = TimeAxis.of(run.stamps)
    at = time.of_scans[run.key_scans]
    if of == "position":
        along = np.sqrt(eigvalsh(run.covariances[:, :2, :2]).clip(min=0.0))
        ax.plot(at, along[:, 1], color=_WIDE, linewidth=1.2, label="widest direction")
        ax.plot(at, along[:, 0], color=_NARROW, linewidth=1.2, label="narrowest direction")
        ax.set_ylabel("position, 1 σ [m]")
    else:
        deviations = np.sqrt(run.covariances[:, 2, 2].clip(min=0.0)) * 180.0 / math.pi
        ax.plot(at, deviations, color=_WIDE, linewidth=1.2, label="heading")
        ax.set_ylabel("heading, 1 σ [°]")
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel(time.label)
    tidy(ax)
    came_in = np.unique(joined_scans(run.closures).max(axis=1, initial=-1))
    marks = time.of_scans[came_in[came_in >= 0]]
    if len(marks):
        ax.vlines(
            marks,
            0.0,
            _MARKS,
            color=CLOSURE_COLOUR,
            linewidth=0.8,
            transform=ax.get_xaxis_transform(),
            label=f"loop closure ({len(joined_scans(run.closures))})",
        )
    ax.set_xlim(0.0, max(float(time.of_scans[-1]), 1e-9))
    ax.legend(fontsize="small", frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
