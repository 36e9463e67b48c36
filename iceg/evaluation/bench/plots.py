"""Pictures of an experiment: error and speed of each method, a panel for each log."""

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
_PANEL_WIDTH, _ROW_HEIGHT = 4.2, 0.32  # inches
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
    figure = Figure(
        figsize=(1.5 + _PANEL_WIDTH * len(logs), 1.2 + _ROW_HEIGHT * max(2, len(methods))), layout="constrained"
    )
    panels = figure.subplots(1, len(logs), sharey=True, squeeze=False)[0]
    for axes, log in zip(panels, logs, strict=True):
        here = [groups.get((method, log), []) for method in methods]
        for row, group in enumerate(here):
            _draw_runs(axes, row, [value_of(outcome) for outcome in group])
        axes.set_title(log)
        axes.set_xlabel(label_of([outcome for group in here for outcome in group]))
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid(axis="x", alpha=0.25)
        axes.set_yticks(range(len(methods)), methods)
        axes.set_ylim(len(methods) - 0.5, -0.5)
    return figure


def _draw_runs(axes: Axes, row: int, values: Sequence[float | None]) -> None:
    """A dot a run and a stroke at their mean; what has no value is told at the margin."""
    present = [value for value in values if value is not None and value > 0]
    axes.plot(present, [row] * len(present), "o", color=_DOT, alpha=0.6, markersize=5)
    if present:
        axes.plot([statistics.fmean(present)], [row], "|", color=_MEAN, markersize=13, markeredgewidth=1.6)
    if len(present) < len(values):
        text = f"{len(values) - len(present)} of {len(values)} without"
        axes.text(0.99, row, text, transform=axes.get_yaxis_transform(), ha="right", va="center", color=_FAILED, size=7)


def _save(figure: Figure, path: Path) -> None:
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=_DOTS_PER_INCH, metadata={"Software": None})
    write_atomically(path, content.getvalue())
