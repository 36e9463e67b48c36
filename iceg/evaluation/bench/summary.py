"""What an experiment found: every run as CSV and Parquet, the seeds of a method and a log as one row of a table."""

import io
import statistics
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from graph.atomic import write_atomically
from iceg.evaluation.bench.outcome import Outcome
from iceg.evaluation.bench.tables import Row, columns_of, write_csv

RESULT_FILES = ("results.csv", "results.parquet")

_ACCURACY = {
    "trans_mean": "relations, mean [m]",
    "trans_median": "relations, median [m]",
    "rot_mean_deg": "relations, mean [°]",
    "ate_rmse": "ATE [m]",
    "x_mean_abs": "x, mean error [m]",
    "y_mean_abs": "y, mean error [m]",
    "rot_rmse_deg": "heading [°]",
    "nees_mean": "NEES",
}
_COST = {"cpu_s": "CPU [s]", "scans_per_cpu_s": "scans/CPU s", "peak_memory_mb": "memory [MB]"}


def error_of(outcome: Outcome) -> float | None:
    """The one error to compare a run by [m]: of relations, else of the absolute trajectory; None without either."""
    return outcome.figures.get("trans_mean", outcome.figures.get("ate_rmse"))


def by_method_and_log(outcomes: Sequence[Outcome]) -> dict[tuple[str, str], list[Outcome]]:
    """The seeds of each method on each log, logs first, in the order of the experiment."""
    logs = dict.fromkeys(outcome.cell.log.name for outcome in outcomes)
    groups: dict[tuple[str, str], list[Outcome]] = {}
    for log in logs:
        for outcome in outcomes:
            if outcome.cell.log.name == log:
                groups.setdefault((outcome.cell.label, log), []).append(outcome)
    return groups


def summary_rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """One row for each method on each log: means over the seeds; if there are several, also the error's deviation."""
    rows: list[Row] = []
    for (method, log), group in by_method_and_log(outcomes).items():
        done = [outcome for outcome in group if outcome.error is None]
        row: Row = {"log": log, "method": method, "runs": len(group), "failed": len(group) - len(done)}
        for name, column in {**_ACCURACY, **_COST}.items():
            values = [outcome.figures[name] for outcome in done if name in outcome.figures]
            row[column] = statistics.fmean(values) if values else None
        errors = [error for outcome in done if (error := error_of(outcome)) is not None]
        row["deviation over runs [m]"] = statistics.stdev(errors) if len(errors) > 1 else None
        speed = row["scans/CPU s"]
        rows.append(row | {"scans/CPU s": None if speed is None else round(float(speed))})
    return _without_empty_columns(rows)


def write_results(outcomes: Sequence[Outcome], output: Path) -> list[Path]:
    """Write `results.csv`, and `results.parquet` where PyArrow is installed: one row a run.

    Returns:
        The files written.
    """
    rows = [outcome.row() for outcome in outcomes]
    table, columnar = (output / name for name in RESULT_FILES)
    write_csv(rows, table)
    if find_spec("pyarrow") is None:
        return [table]
    _write_parquet(rows, columnar)
    return [table, columnar]


def _write_parquet(rows: Sequence[Row], path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {name: _of_one_type([row.get(name) for row in rows]) for name in columns_of(rows)}
    content = io.BytesIO()
    pq.write_table(pa.table({name: pa.array(values) for name, values in columns.items()}), content)
    write_atomically(path, content.getvalue())


def _of_one_type(values: list[float | int | str | None]) -> list[float | None] | list[int | None] | list[str | None]:
    """A column as numbers if all are, else as text: methods may give a setting values of different kinds."""
    present = [value for value in values if value is not None]
    if all(type(value) is int for value in present) and present:
        return [None if value is None else int(value) for value in values]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in present) and present:
        return [None if value is None else float(value) for value in values]
    return [None if value is None else str(value) for value in values]


def _without_empty_columns(rows: list[Row]) -> list[Row]:
    used = [name for name in columns_of(rows) if any(row.get(name) is not None for row in rows)]
    return [{name: row.get(name) for name in used} for row in rows]
