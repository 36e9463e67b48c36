"""A floor plan as PDF, true to scale."""

from pathlib import Path
from typing import TYPE_CHECKING

from iceg.floor_plan.config import FloorPlanError
from iceg.floor_plan.plan import FloorPlan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SCALES = (20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)
_LARGEST_SIDE = 0.55
"""Of the drawing on paper [m]: about that of A2."""
_MARGIN = 0.015
"""Around it, on paper [m]."""
_INCH = 0.0254


def write_pdf(plan: FloorPlan, path: Path) -> None:
    """Write a plan at the largest usual scale that A2 holds.

    Args:
        plan: the walls.
        path: the file, written atomically.

    Raises:
        FloorPlanError: the plan is larger than any usual scale brings onto paper.
    """
    from iceg.show.run_plots import save_figure

    save_figure(_sheet(plan, path), path)


def _sheet(plan: FloorPlan, path: Path) -> "Figure":
    from matplotlib.figure import Figure

    from iceg import plot

    x_min, x_max, y_min, y_max = plan.box
    side = max(x_max - x_min, y_max - y_min)
    scale = next((scale for scale in _SCALES if side / scale <= _LARGEST_SIDE), None)
    if scale is None:
        raise FloorPlanError(f"{path}: the walls span {side:.0f} m, expected at most {_SCALES[-1] * _LARGEST_SIDE:g} m")
    margin = _MARGIN * scale
    left, right, bottom, top = x_min - margin, x_max + margin, y_min - margin, y_max + margin
    width, height = (right - left) / scale / _INCH, (top - bottom) / scale / _INCH
    figure = Figure(figsize=(width, height))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    plot.floor_plan(plan, ax)
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    ax.set_axis_off()
    metres = f"{plan.name}, 1:{scale}" if plan.name else f"1:{scale}"
    ax.text(0.5 * _MARGIN * scale + left, top - 0.3 * margin, metres, fontsize=7, va="top")
    return figure
