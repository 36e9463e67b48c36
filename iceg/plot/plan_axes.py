"""A floor plan on axes."""

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from iceg.floor_plan.plan import FloorPlan
from iceg.floor_plan.plan import floor_plan as plan_of
from iceg.plot.map_axes import draw_scale_bar
from iceg.show.drawn_run import drawn_run

if TYPE_CHECKING:
    from iceg.run_folder import RunFolder
    from iceg.run_result.slam_result import SlamResult

_WALL, _DOUBT = "#141414", "#c1272d"


def floor_plan(run: "SlamResult | RunFolder | FloorPlan", ax: Axes) -> None:
    """Draw walls as straight lines, those seen with doubt thin and red, with a scale bar.

    Args:
        run: a run, or its floor plan.
        ax: axes to draw on; aspect and limits are set, ticks removed.
    """
    plan = run if isinstance(run, FloorPlan) else plan_of(run.walls, name=drawn_run(run).name)
    ax.add_collection(LineCollection(list(plan.doubtful), colors=_DOUBT, linewidths=0.6, capstyle="round"))
    ax.add_collection(LineCollection(list(plan.sure), colors=_WALL, linewidths=1.2, capstyle="round"))
    x_min, x_max, y_min, y_max = plan.box
    margin = 0.02 * max(x_max - x_min, y_max - y_min, 1.0)
    ax.set(xlim=(x_min - margin, x_max + margin), ylim=(y_min - margin, y_max + margin))
    ax.set(xticks=[], yticks=[], aspect="equal")
    for spine in ax.spines.values():
        spine.set_visible(False)
    draw_scale_bar(ax, x_max - x_min)
