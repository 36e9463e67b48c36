"""Accuracy and speed on the logs at hand: runs them, prints the tables, keeps them as CSV."""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from graph.errors import IcegError
from iceg.evaluation.bench.logs import BenchLog, find_logs
from iceg.evaluation.bench.tables import Row, format_markdown, write_csv
from iceg.evaluation.errors import EvaluationError

Part = Literal["runs", "recall", "consistency", "ablation"]
_SEEDS = range(5)


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Accuracy and speed on the embedded log and on the public ones at hand."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for runs and tables.")]
    data: Annotated[
        Path | None, tyro.conf.arg(metavar="DIR", help="Folder of public logs; left out: $ICEG_DATA, else none.")
    ] = None
    parts: Annotated[tuple[Part, ...], tyro.conf.arg(help="Which tables.")] = field(
        default=("runs", "recall", "consistency", "ablation")
    )

    def __call__(self) -> None:
        """Make the tables one after the other; each is printed and kept as soon as it is complete."""
        logs = find_logs(self._folder_of_logs())
        self.output.mkdir(parents=True, exist_ok=True)
        for part in self.parts:
            for name, rows in _PARTS[part](logs, self.output):
                if rows:
                    print(f"\n{name.replace('-', ' ').capitalize()}\n{format_markdown(rows)}", flush=True)
                    write_csv(rows, self.output / f"{name}.csv")

    def _folder_of_logs(self) -> Path | None:
        named = self.data or (Path(os.environ["ICEG_DATA"]) if os.environ.get("ICEG_DATA") else None)
        if self.data is not None and not self.data.is_dir():
            raise EvaluationError(f"{self.data}: is no folder, expected one with public logs")
        if named is None or not named.is_dir():
            print("No folder of public logs (--data, or ICEG_DATA): the embedded log only.")
            return None
        return named


def _runs(logs: list[BenchLog], output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.runs import MODES, accuracy_and_speed, run_in_fresh_process

    with tempfile.TemporaryDirectory() as folder:
        run_in_fresh_process(logs[0].path, Path(folder))  # compiles what is not compiled yet
    rows = [accuracy_and_speed(log, mode, output) for log in logs for mode in MODES]
    yield "accuracy", [accuracy for accuracy, _ in rows]
    yield "speed", [speed for _, speed in rows]


def _recall(logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.recall import recall_rows

    yield "recall", [row for log in logs if log.relations for row in recall_rows(log)]


def _consistency(_logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.consistency import SCENES, factor_consistency

    yield "consistency-of-ice-factors", [factor_consistency(scene, _SEEDS) for scene in SCENES]


def _ablation(logs: list[BenchLog], _output: Path) -> Iterator[tuple[str, list[Row]]]:
    from iceg.evaluation.bench.ablation import ablation

    yield "ablation-of-features", [ablation(log, on) for log in logs if log.relations for on in (True, False)]


_PARTS: dict[Part, Callable[[list[BenchLog], Path], Iterator[tuple[str, list[Row]]]]] = {
    "runs": _runs,
    "recall": _recall,
    "consistency": _consistency,
    "ablation": _ablation,
}


def main() -> int:
    """Run the benchmark; 1 when a run failed."""
    try:
        tyro.cli(Bench, prog="python -m iceg.evaluation.bench")()
    except IcegError as err:
        print(f"iceg: {err}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
