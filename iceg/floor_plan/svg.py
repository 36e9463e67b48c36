"""A floor plan as SVG: coordinates in metres, a group a layer, printed at 1:50."""

from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from graph.atomic import write_atomically
from iceg.floor_plan.plan import FloorPlan

_MARGIN = 0.5
_MM_PER_METRE = 20.0
_WALL, _DOUBT = 0.04, 0.02
"""Widths of the lines [m]."""


def write_svg(plan: FloorPlan, path: Path) -> None:
    """Write a plan; the y axis points up, as in the map frame.

    Args:
        plan: the walls.
        path: the file, written atomically.
    """
    x_min, x_max, y_min, y_max = plan.box
    width, height = x_max - x_min + 2 * _MARGIN, y_max - y_min + 2 * _MARGIN
    view = f"{x_min - _MARGIN:.3f} {-y_max - _MARGIN:.3f} {width:.3f} {height:.3f}"
    size = f'width="{_MM_PER_METRE * width:.1f}mm" height="{_MM_PER_METRE * height:.1f}mm"'
    text = (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="{view}">\n'
        f"<title>Floor plan of {escape(plan.name)}, metres, printed 1:50</title>\n"
        f'<g id="plan" transform="scale(1 -1)" fill="none" stroke-linecap="round">\n'
        f"{_layer('walls-in-doubt', plan.doubtful, '#c1272d', _DOUBT)}"
        f"{_layer('walls', plan.sure, '#141414', _WALL)}"
        "</g>\n</svg>\n"
    )
    write_atomically(path, text.encode())


def _layer(name: str, walls: NDArray[np.float64], colour: str, width: float) -> str:
    lines = "".join(
        f'<path d="M{first[0]:.4f} {first[1]:.4f}L{second[0]:.4f} {second[1]:.4f}"/>\n'
        for first, second in walls.tolist()
    )
    return f'<g id="{name}" stroke="{colour}" stroke-width="{width}">\n{lines}</g>\n'
