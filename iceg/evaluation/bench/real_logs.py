"""Accuracy and speed of ICE on the embedded log and on the public ones at hand: the tables of docs/accuracy.md."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from iceg.evaluation.bench.logs import BenchLog, find_logs
from iceg.evaluation.bench.tables import Row, write_csv

Part = Literal["runs", "recall", "consistency", "ablation", "solvers", "growth", "mapper"]
PARTS: tuple[Part, ...] = ("runs", "recall", "consistency", "ablation", "solvers")
"""What is made unless parts are named: growth and mapper take many minutes."""
_SEEDS = range(5)
_THE_SAME = 1e-3
"""Translations that differ by less are one [m]."""
_GRID = 0.05
"""Spacing of the grid that relations are held against [m]."""


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


def _runs(logs: list[BenchLog], output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.runs import MODES, accuracy_and_speed, run_in_fresh_process

    with tempfile.TemporaryDirectory() as folder:
        run_in_fresh_process(logs[0].path, Path(folder))  # compiles what is not compiled yet
    rows = [accuracy_and_speed(log, mode, output) for log in logs for mode in MODES]
    yield "accuracy", [accuracy for accuracy, _ in rows]
    yield "relations-themselves", [_relations_themselves(log) for log in logs if log.relations]
    yield "speed", [speed for _, speed in rows]


def _relations_themselves(log: BenchLog) -> Row:
    """What the relations of a log are off by, without any trajectory of ours."""
    from frontends.logs import read_log
    from iceg.evaluation.relations import on_odometry_grid, read_relations_csv, relation_errors, triangle_errors

    assert log.relations is not None
    relations = read_relations_csv(log.relations)
    triangles = triangle_errors(relations)
    odometry = read_log(log.path).odometry
    off_odometry, on_grid = relation_errors(odometry, relations), on_odometry_grid(relations, odometry, _GRID)
    return {
        "log": log.name,
        "relations": len(relations),
        "triangles": len(triangles.translation),
        "translation median [m]": float(np.median(triangles.translation)),
        "rotation mean [°]": float(np.degrees(triangles.rotation.mean())),
        "with the translation of raw odometry": int(np.count_nonzero(off_odometry.translation < _THE_SAME)),
        f"on a grid of {_GRID} m around raw odometry": f"{np.count_nonzero(on_grid)} of {len(on_grid)} near it",
    }


def _recall(logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.recall import recall_rows

    yield "recall", [row for log in logs if log.relations for row in recall_rows(log)]


def _consistency(_logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.consistency import SCENES, factor_consistency

    yield "consistency-of-ice-factors", [factor_consistency(scene, _SEEDS) for scene in SCENES]


def _ablation(logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.thinned_logs import features_on_thinned

    yield (
        "ablation-of-features",
        [features_on_thinned(log, on) for log in logs if log.relations for on in (True, False)],
    )


def _solvers(logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.solvers import solver_rows

    yield "solvers", [row for log in logs for row in solver_rows(log)]


def _growth(_logs: list[BenchLog], output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.growth import PICTURE, growth_rows, long_runs, save_plot, simulated_log

    folder = output / "growth"
    simulated_log(folder)
    runs = list(long_runs(folder))
    save_plot(runs, output / PICTURE)
    yield "growth", growth_rows(runs)


def _mapper(logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.mapper import mapper_rows

    yield "mapper", list(mapper_rows(logs))


_TABLES: dict[Part, Callable[[list[BenchLog], Path], Iterator[tuple[str, list[Row]]]]] = {
    "runs": _runs,
    "recall": _recall,
    "consistency": _consistency,
    "ablation": _ablation,
    "solvers": _solvers,
    "growth": _growth,
    "mapper": _mapper,
}
