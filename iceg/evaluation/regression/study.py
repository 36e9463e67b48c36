"""The whole table, recording by recording, on as many processors as wanted."""

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from tqdm import tqdm

from iceg.evaluation.bench.runs import ONE_CORE
from iceg.evaluation.bench.tables import Row, write_csv
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.cells import Cell
from iceg.evaluation.regression.comparison import compare
from iceg.evaluation.regression.outcome import Outcome, write_outcomes
from iceg.evaluation.regression.runner import run_task, tasks
from iceg.evaluation.regression.totals import Totals, by_group

_Given = TypeVar("_Given")
_Found = TypeVar("_Found")
OUTCOMES, RULES_TABLE = "regression.csv", "rules.csv"
Tell = Callable[[str, Sequence[Outcome]], None]
"""Called with a rule, "" for none, and what became of the cells of one recording."""


def outcomes_of(cells: Sequence[Cell], data: Path | None, output: Path, workers: int, tell: Tell) -> list[Outcome]:
    """Run cells and keep what became of them.

    Args:
        cells: what to run.
        data: folder of the public logs.
        output: folder of `regression.csv`, made if missing.
        workers: processes at a time.
        tell: called as recordings are done.

    Returns:
        An outcome for each cell, in their order.

    Raises:
        IcegError: a recording is not there.
    """
    output.mkdir(parents=True, exist_ok=True)
    found = _in_order(cells, (one for _, done in _run(cells, data, ("",), workers, tell) for one in done))
    write_outcomes(found, output / OUTCOMES)
    return found


def rule_rows(
    cells: Sequence[Cell],
    data: Path | None,
    rules: Sequence[str],
    output: Path,
    workers: int,
    tell: Tell,
    on: str = "",
) -> list[Row]:
    """Run cells as they are and with each rule switched off, and compare.

    Args:
        cells: what to run.
        data: folder of the public logs.
        rules: names of `RULES`.
        output: folder of `rules.csv`, a row a rule, and of `rule-NAME.csv`, a row a cell, as they are done; made if
            missing.
        workers: processes at a time.
        tell: called as recordings are done.
        on: what the cells are, for the table; their groups when left out.

    Returns:
        A row for nothing switched off, and one for each rule.

    Raises:
        IcegError: a recording is not there, or a rule is not.
    """
    output.mkdir(parents=True, exist_ok=True)
    by_rule: dict[str, list[Outcome]] = {"": [], **{rule: [] for rule in rules}}
    for rule, done in _run(cells, data, tuple(by_rule), workers, tell):
        by_rule[rule] = _in_order(cells, [*by_rule[rule], *done])
        write_outcomes(by_rule[rule], output / f"rule-{(rule or 'nothing').replace(' ', '-')}.csv")
    rows = compared(by_rule, on)
    write_csv(rows, output / RULES_TABLE)
    return rows


def compared(tables: dict[str, list[Outcome]], on: str = "") -> list[Row]:
    """A row for nothing switched off, named "", and one for each rule: what the table becomes without it."""
    before = tables[""]
    whole = Totals.of(before).row()
    del whole["CPU [s]"]
    on = on or ", ".join(dict.fromkeys(one.group for one in before))
    rows: list[Row] = [{"off": "nothing", "on": on, **whole}]
    rows += [{"off": rule, "on": on, **compare(before, after).row()} for rule, after in tables.items() if rule]
    return rows


def total_rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """A row for each group of cells, and one for all."""
    return [{"group": group, **Totals.of(some).row()} for group, some in by_group(outcomes)]


def compared_by_group(before: Sequence[Outcome], after: Sequence[Outcome]) -> list[Row]:
    """A row for each group of the cells that two tables have in common, and one for all."""
    known = {outcome.name for outcome in before}
    return [
        {"group": group, **compare(before, some).row()}
        for group, some in by_group([outcome for outcome in after if outcome.name in known])
    ]


def _run(
    cells: Sequence[Cell], data: Path | None, rules: Sequence[str], workers: int, tell: Tell
) -> Iterator[tuple[str, list[Outcome]]]:
    work = sorted(tasks(cells, data, rules), key=lambda task: -len(task.cells))
    context = multiprocessing.get_context("spawn")
    with _one_core_each(), ProcessPoolExecutor(workers, mp_context=context, initializer=_load_kernels) as pool:
        try:
            for done in pool.map(run_task, work):
                for rule, some in done:
                    tell(rule, some)
                    yield rule, some
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _in_order(cells: Sequence[Cell], outcomes: Iterable[Outcome]) -> list[Outcome]:
    """Those there are so far, in the order of the cells."""
    found = {outcome.name: outcome for outcome in outcomes}
    return [found[cell.name] for cell in cells if cell.name in found]


def of_scenes(work: Callable[[_Given], _Found], scenes: Sequence[_Given], workers: int) -> list[_Found]:
    """What becomes of each scene, in so many processes at a time; progress is shown.

    Raises:
        EvaluationError: fewer than one.
    """
    if workers < 1:
        raise EvaluationError(f"found {workers} workers, expected one at least")
    context = multiprocessing.get_context("spawn")
    with _one_core_each(), ProcessPoolExecutor(workers, mp_context=context) as pool:
        return list(tqdm(pool.map(work, scenes), total=len(scenes), unit=" scenes"))


@contextmanager
def _one_core_each() -> Iterator[None]:
    """Processes that are started within stay on one core."""
    before = {name: os.environ.get(name) for name in ONE_CORE}
    os.environ.update(ONE_CORE)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _load_kernels() -> None:
    """Run a little, so that loading and compiling kernels is not taken for the time of the first recording."""
    from frontends.logs import read_log
    from iceg.demo import demo_log_path
    from iceg.evaluation.regression.runner import CONFIG
    from iceg.pipeline import run

    run(read_log(demo_log_path()).select(slice(0, 400)), CONFIG)
