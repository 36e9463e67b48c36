"""Pictures of an experiment: error and speed of each method with the mean's value, a panel for each log."""

import io
import statistics
from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from graph.atomic import write_atomically
from iceg.evaluation.bench.outcome import Outcome
from iceg.evaluation.bench.summary import by_method_and_log, error_of

PICTURES = ("error.png", "speed.png")

_DOT, _MEAN, _FAILED = "#0072b2", "#222222", "#c1272d"
_COLUMNS = 2
_WIDTH, _ROOM, _ROW_HEIGHT = 8.5, 0.9, 0.38
"""In inches: a figure that a README shows as it is, what a panel needs besides its rows, and a row."""
_DOTS_PER_INCH = 130


def save_plots(outcomes: Sequence[Outcome], output: Path) -> list[Path]:
    """Draw `error.png` and `speed.png`.

    Returns:
        The files written.
    """
    errors, speeds = (output / name for name in PICTURES)
    _save(_figure(outcomes, error_of, _error_label), errors)
    _save(_figure(outcomes, lambda outcome: outcome.figures.get("scans_per_cpu_s"), _speed_label), speeds)
    return [errors, speeds]


def _error_label(outcomes: Sequence[Outcome]) -> str:
    relations = any("trans_mean" in outcome.figures for outcome in outcomes)
    return "mean error of relations [m]" if relations else "absolute trajectory error [m]"


def _speed_label(_outcomes: Sequence[Outcome]) -> str:
    return "scans per CPU second"


def _figure(
    outcomes: Sequence[Outcome],
    value_of: Callable[[Outcome], float | None],
    label_of: Callable[[Sequence[Outcome]], str],
) -> Figure:
    groups = by_method_and_log(outcomes)
    logs = list(dict.fromkeys(log for _, log in groups))
    methods = list(dict.fromkeys(method for method, _ in groups))
    columns = min(len(logs), _COLUMNS)
    rows = -(-len(logs) // columns)
    height = rows * (_ROOM + _ROW_HEIGHT * max(2, len(methods)))
    figure = Figure(figsize=(_WIDTH if columns > 1 else 0.6 * _WIDTH, height), layout="constrained")
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for spare in panels.flat[len(logs) :]:
        spare.set_axis_off()
    for axes, log in zip(panels.flat, logs, strict=False):
        here = [groups.get((method, log), []) for method in methods]
        for row, group in enumerate(here):
            _draw_runs(axes, row, [value_of(outcome) for outcome in group])
        axes.set_title(log, fontsize="medium")
        axes.set_xlabel(label_of([outcome for group in here for outcome in group]))
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.margins(x=0.15)
        axes.grid(axis="x", alpha=0.25)
        axes.set_yticks(range(len(methods)), methods)
        axes.set_ylim(len(methods) - 0.5, -0.6)
    for axes in panels[:, 0]:
        axes.set_ylabel("method")
    return figure


def _draw_runs(axes: Axes, row: int, values: Sequence[float | None]) -> None:
    """A dot a run, a stroke at their mean with its value; what has no value is told at the margin."""
    present = [value for value in values if value is not None and value > 0]
    axes.plot(present, [row] * len(present), "o", color=_DOT, alpha=0.6, markersize=5)
    if present:
        mean = statistics.fmean(present)
        axes.plot([mean], [row], "|", color=_MEAN, markersize=13, markeredgewidth=1.6)
        axes.annotate(
            f"{mean:.3g}", (mean, row), (0, 7), textcoords="offset points", ha="center", color=_MEAN, fontsize=7
        )
    if len(present) < len(values):
        text = f"{len(values) - len(present)} of {len(values)} without"
        axes.text(0.99, row + 0.4, text, transform=axes.get_yaxis_transform(), ha="right", color=_FAILED, size=7)


def _save(figure: Figure, path: Path) -> None:
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=_DOTS_PER_INCH, metadata={"Software": None})
    write_atomically(path, content.getvalue())
