"""Accuracy and speed of ICE on the embedded log and on the public ones at hand: the tables of the README."""

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from iceg.evaluation.bench.logs import BenchLog, find_logs
from iceg.evaluation.bench.tables import Row, write_csv
from iceg.evaluation.errors import EvaluationError

Part = Literal["runs", "recall", "consistency", "ablation"]
PARTS: tuple[Part, ...] = ("runs", "recall", "consistency", "ablation")
_SEEDS = range(5)


def real_log_tables(data: Path | None, output: Path, parts: Sequence[Part] = PARTS) -> Iterator[tuple[str, list[Row]]]:
    """Make the tables one after the other; each is kept as CSV as soon as it is complete.

    Args:
        data: the folder of public logs; None for the embedded log alone.
        output: folder for runs and tables.
        parts: which tables.

    Yields:
        Name and rows of each table that is not empty.

    Raises:
        IcegError: a run failed.
    """
    logs = find_logs(data)
    output.mkdir(parents=True, exist_ok=True)
    for part in parts:
        for name, rows in _TABLES[part](logs, output):
            if rows:
                write_csv(rows, output / f"{name}.csv")
                yield name, rows


def folder_of_logs(given: Path | None) -> Path | None:
    """The folder of public logs: the one given, else the one that `ICEG_DATA` names; None when that is not there.

    Raises:
        EvaluationError: the one given is no folder.
    """
    if given is not None and not given.is_dir():
        raise EvaluationError(f"{given}: is no folder, expected one with public logs")
    named = given or (Path(os.environ["ICEG_DATA"]) if os.environ.get("ICEG_DATA") else None)
    return named if named is not None and named.is_dir() else None


def _runs(logs: list[BenchLog], output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.runs import MODES, accuracy_and_speed, run_in_fresh_process

    with tempfile.TemporaryDirectory() as folder:
        run_in_fresh_process(logs[0].path, Path(folder))  # compiles what is not compiled yet
    rows = [accuracy_and_speed(log, mode, output) for log in logs for mode in MODES]
    yield "accuracy", [accuracy for accuracy, _ in rows]
    yield "relations-against-each-other", [row for log in logs if log.relations for row in _triangles(log)]
    yield "speed", [speed for _, speed in rows]


def _triangles(log: BenchLog) -> Iterator[Row]:
    """What relations of three scans that are all joined miss to be consistent."""
    from iceg.evaluation.relations import read_relations_csv, triangle_errors

    assert log.relations is not None
    errors = triangle_errors(read_relations_csv(log.relations))
    if len(errors.translation):
        yield {
            "log": log.name,
            "triangles": len(errors.translation),
            "translation median [m]": float(np.median(errors.translation)),
            "translation mean [m]": float(errors.translation.mean()),
            "rotation mean [°]": float(np.degrees(errors.rotation.mean())),
        }


def _recall(logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.recall import recall_rows

    yield "recall", [row for log in logs if log.relations for row in recall_rows(log)]


def _consistency(_logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.consistency import SCENES, factor_consistency

    yield "consistency-of-ice-factors", [factor_consistency(scene, _SEEDS) for scene in SCENES]


def _ablation(logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.ablation import ablation

    yield "ablation-of-features", [ablation(log, on) for log in logs if log.relations for on in (True, False)]


_TABLES: dict[Part, Callable[[list[BenchLog], Path], Iterator[tuple[str, list[Row]]]]] = {
    "runs": _runs,
    "recall": _recall,
    "consistency": _consistency,
    "ablation": _ablation,
}
