"""An experiment run to its end: what is there already is kept, what fails is told, the rest goes on."""

import os
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from iceg.evaluation.bench.executors import run_here, run_on_dask
from iceg.evaluation.bench.experiment import Experiment
from iceg.evaluation.bench.outcome import Outcome, keep, kept

Tell = Callable[[Outcome, int, int], None]


def run_experiment(
    experiment: Experiment,
    output: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    overwrite: bool = False,
    tell: Tell | None = None,
) -> list[Outcome]:
    """Run every cell that is not in the output folder with the same settings, logs, seed and version.

    Args:
        experiment: what to run.
        output: `result.json` and `trajectory.tum` of each run go into `cells/` there as soon as it is complete.
        workers: how many at a time on this machine; one for each core when left out.
        scheduler: address of a Dask scheduler whose workers run the cells instead.
        overwrite: run all of them again.
        tell: called with each outcome, the number of outcomes so far and of all.

    Returns:
        One outcome a cell, in the order of the experiment.

    Raises:
        EvaluationError: there is no such cluster, or a file of the experiment cannot be read.
    """
    cells = output / "cells"
    cells.mkdir(parents=True, exist_ok=True)
    digests = {cell.name: cell.digest() for cell in experiment.cells}
    outcomes: dict[str, Outcome] = {}

    def done(outcome: Outcome) -> None:
        outcomes[outcome.cell.name] = outcome
        if tell is not None:
            tell(outcome, len(outcomes), len(experiment.cells))

    for cell in experiment.cells:
        earlier = None if overwrite else kept(cell, digests[cell.name], cells)
        if earlier is not None:
            done(earlier)
    left = [cell for cell in experiment.cells if cell.name not in outcomes]
    if not left:
        return [outcomes[cell.name] for cell in experiment.cells]
    if scheduler is None:
        running = run_here(left, min(workers or os.cpu_count() or 1, len(left)), experiment.time_limit_s)
    else:
        running = run_on_dask(left, scheduler, experiment.time_limit_s)
    with closing(running):  # ends its processes even where an interrupt comes while an outcome is kept
        for outcome in running:
            keep(outcome, digests[outcome.cell.name], cells)
            done(outcome)
    return [outcomes[cell.name] for cell in experiment.cells]
