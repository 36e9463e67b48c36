"""Two runs side by side as one page that needs nothing else: both maps under a slider, curves and tables."""

import base64
import math
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np
from numpy.typing import NDArray

from graph.atomic import write_atomically
from iceg.compare.comparison import BEYOND, Comparison, Interval
from iceg.compare.map_pair import MapPair

_WIDTH, _HEIGHT, _LEFT, _BELOW = 1000.0, 150.0, 56.0, 22.0
_MOST_ROWS = 200


def write_page(comparison: Comparison, maps: MapPair, names: tuple[str, str], path: Path) -> None:
    """Write the page; the same runs give the same bytes.

    Args:
        comparison: of the runs.
        maps: their pictures.
        names: of run A and run B.
        path: the HTML file, written atomically.
    """
    a, b = (escape(name) for name in names)
    template = Template((files("iceg.compare") / "page.html").read_text(encoding="utf-8"))
    text = template.substitute(
        title=f"{a} and {b}",
        figures=_figures(comparison),
        image_a=base64.b64encode(maps.a).decode(),
        image_b=base64.b64encode(maps.b).decode(),
        width=maps.width,
        height=maps.height,
        name_a=a,
        name_b=b,
        curves=_curves(comparison),
        intervals=_intervals(comparison.intervals),
        closures=_closures(comparison),
    )
    write_atomically(path, text.encode())


def _figures(comparison: Comparison) -> str:
    lone = comparison.lone_closures
    figures = {
        "mean distance": f"{_length(comparison.mean_distance)}",
        "largest distance": f"{_length(comparison.largest_distance)}",
        "key poses that differ beyond both claims": f"{100 * float((comparison.sigmas > BEYOND).mean()):.1f} %",
        "closures in both": f"{comparison.shared_closures}",
        "closures only in A": f"{sum(closure.only_in == 'A' for closure in lone)}",
        "closures only in B": f"{sum(closure.only_in == 'B' for closure in lone)}",
    }
    return "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in figures.items())


def _intervals(intervals: Sequence[Interval]) -> str:
    if not intervals:
        return "<p>Nowhere.</p>"
    head = ("scans", "largest distance", "largest turn", "σ", "at scan")
    rows = [
        (
            f"{interval.first_scan}–{interval.last_scan}",
            _length(interval.distance),
            f"{math.degrees(interval.turn):.2f}°",
            f"{interval.sigmas:.1f}",
            f"{interval.worst_scan}",
        )
        for interval in intervals
    ]
    return _table(head, rows, numbers=True) + (
        f"<p>More than {BEYOND:.2f} σ of both covariances together: 99 % of what independent runs would differ by.</p>"
    )


def _closures(comparison: Comparison) -> str:
    if not comparison.lone_closures:
        return "<p>None.</p>"
    rows = [
        (closure.only_in, f"{closure.scan_i}", f"{closure.scan_j}", escape(closure.elsewhere))
        for closure in comparison.lone_closures
    ]
    return _table(("only in", "scan", "and scan", "the other run says"), rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: bool = False) -> str:
    kind = ' class="n"' if numbers else ""
    names = "".join(f"<th{kind}>{name}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td{kind}>{cell}</td>" for cell in row) + "</tr>" for row in rows[:_MOST_ROWS])
    more = f"<p>The first {_MOST_ROWS} of {len(rows)}.</p>" if len(rows) > _MOST_ROWS else ""
    return f'<div class="scroll"><table><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table></div>{more}'


def _curves(comparison: Comparison) -> str:
    unit, per_metre = ("m", 1.0) if comparison.distances.max(initial=0.0) >= 1.0 else ("mm", 1000.0)
    return _curve(comparison.scans, per_metre * comparison.distances, f"distance [{unit}]") + _curve(
        comparison.scans, comparison.sigmas, "difference [σ]", mark=BEYOND
    )


def _curve(scans: NDArray[np.int64], values: NDArray[np.float64], label: str, mark: float | None = None) -> str:
    """A curve over the scans, with a dashed line at a mark."""
    top = max(float(values.max(initial=0.0)), 0.0 if mark is None else 1.2 * mark, 1e-9)
    last = max(int(scans[-1]) if len(scans) else 1, 1)
    x = _LEFT + (_WIDTH - _LEFT) * scans / last
    y = _HEIGHT * (1.0 - values / (1.05 * top))
    points = " ".join(f"{right:.1f},{down:.1f}" for right, down in zip(x.tolist(), y.tolist(), strict=True))
    dashed = ""
    if mark is not None:
        level = _HEIGHT * (1.0 - mark / (1.05 * top))
        dashed = (
            f'<line x1="{_LEFT}" x2="{_WIDTH}" y1="{level:.1f}" y2="{level:.1f}" stroke="var(--red)" '
            f'stroke-dasharray="6 4"/><text x="{_WIDTH}" y="{level - 4:.1f}" text-anchor="end">{mark:.2f} σ</text>'
        )
    floor = _HEIGHT + 16
    return (
        f'<svg viewBox="0 -14 {_WIDTH:g} {_HEIGHT + _BELOW + 14:g}" role="img" aria-label="{label} over the scans">'
        f'<path d="M{_LEFT} 0V{_HEIGHT}H{_WIDTH}" fill="none" stroke="var(--line)"/>{dashed}'
        f'<polyline points="{points}" fill="none" stroke="var(--blue)" stroke-width="1.2"/>'
        f'<text x="{_LEFT + 4}" y="-2">{label}</text>'
        f'<text x="{_LEFT - 6}" y="{_HEIGHT * (1 - 1 / 1.05) + 4:.1f}" text-anchor="end">{top:.3g}</text>'
        f'<text x="{_LEFT - 6}" y="{_HEIGHT}" text-anchor="end">0</text>'
        f'<text x="{_LEFT}" y="{floor}">scan 0</text>'
        f'<text x="{_WIDTH}" y="{floor}" text-anchor="end">{last}</text></svg>'
    )


def _length(metres: float) -> str:
    return f"{1000 * metres:.1f} mm" if metres < 1.0 else f"{metres:.2f} m"
