"""The distribution of NEES values beside the one they should have."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from graph.atomic import write_atomically
from graph.elementary import exp

_BARS, _RIGHT = "#0072b2", "#222222"
_FARTHEST, _BINS = 15.0, 60
_EXPECTED = 3.0
_COLUMNS = 3
_PANEL = (2.9, 2.8)  # inches
_DOTS_PER_INCH = 130


def save_nees_plot(values: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    """A histogram for each kind, with the density of χ² with three degrees of freedom.

    Args:
        values: (m,) NEES of each kind; kinds without any are left out.
        path: the PNG file.
    """
    present = {kind: found for kind, found in values.items() if len(found)}
    columns = min(_COLUMNS, max(1, len(present)))
    rows = -(-max(1, len(present)) // columns)
    figure = Figure(figsize=(_PANEL[0] * columns, _PANEL[1] * rows), layout="constrained")
    edges = np.linspace(0.0, _FARTHEST, _BINS + 1)
    x = np.linspace(1e-3, _FARTHEST, 400)
    panels = figure.subplots(rows, columns, sharey=True, sharex=True, squeeze=False)
    for axes, (kind, found) in zip(panels.flat, present.items(), strict=False):
        share = np.histogram(found, edges)[0] / len(found) / np.diff(edges)
        axes.stairs(share, edges, fill=True, color=_BARS, alpha=0.5, label=f"{len(found)} values")
        axes.plot(x, np.sqrt(x / (2.0 * np.pi)) * exp(-0.5 * x), color=_RIGHT, label="χ², 3 degrees of freedom")
        axes.axvline(found.mean(), color=_BARS, linewidth=1.2, label=f"mean {found.mean():.2f}")
        axes.axvline(_EXPECTED, color=_RIGHT, linewidth=0.8, linestyle=":", label=f"{_EXPECTED:g} is right")
        axes.set_title(kind, fontsize="medium")
        axes.set_xlabel(f"NEES, {100 * float((found > _FARTHEST).mean()):.1f} % beyond {_FARTHEST:g}")
        axes.tick_params(labelbottom=True)
        axes.legend(frameon=False, fontsize=7)
    for spare in panels.flat[len(present) :]:
        spare.set_axis_off()
    for axes in panels[:, 0]:
        axes.set_ylabel("probability density")
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=_DOTS_PER_INCH, metadata={"Software": None})
    write_atomically(path, content.getvalue())
