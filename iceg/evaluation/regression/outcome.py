"""What became of each cell, and the file that keeps it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from iceg.evaluation.bench.tables import Row, write_csv
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.verdict import Verdict, verdict

_DIGITS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """One cell of the table.

    Attributes:
        group: see `Cell` …
        source: …
        fault: …
        seed: ….
        error_m: of the trajectory, or of relations [m].
        odometry_m: the same of the odometry as it was recorded, without any fault.
        given_m: the same of the odometry that the run was given, faults and all; None in a log without.
        usual_m: error of the log without its fault [m]; 0 where there is none.
        is_said: whether the run says that something is wrong with it.
        nees: mean over its key poses; None where the truth is not known exactly.
        cpu_s: processor time [s]; to be compared with that of the same machine in the same hour only.
    """

    group: str
    source: str
    fault: str
    seed: int
    error_m: float
    odometry_m: float
    given_m: float | None
    usual_m: float
    is_said: bool
    nees: float | None
    cpu_s: float

    @property
    def family(self) -> str:
        """Cells that differ by their noise alone."""
        return f"{self.source}, {self.fault}"

    @property
    def name(self) -> str:
        """Of the cell."""
        return f"{self.family}, {self.seed}"

    @property
    def verdict(self) -> Verdict:
        """What became of it."""
        return verdict(self.error_m, self.odometry_m, self.is_said, self.usual_m)

    @property
    def is_worse_than_odometry(self) -> bool:
        """Whether the run has spoilt what it was given, and it matters."""
        return self.given_m is not None and self.error_m > self.given_m and not self.verdict.is_good


def write_outcomes(outcomes: Sequence[Outcome], path: Path) -> None:
    """Write one row a cell as CSV, figures rounded to micrometres."""
    write_csv([_row(outcome) for outcome in outcomes], path)


def read_outcomes(path: Path) -> list[Outcome]:
    """Read what `write_outcomes` wrote.

    Raises:
        EvaluationError: the file is not there, or holds something else.
    """
    import csv

    try:
        with path.open(newline="", encoding="utf-8") as stream:
            reader = csv.DictReader(stream)
            found = tuple(reader.fieldnames or ())
            if found != _COLUMNS:
                raise EvaluationError(f"{path}: found the columns {', '.join(found)}, expected {', '.join(_COLUMNS)}")
            return [_parsed(row, f"{path}:{number}") for number, row in enumerate(reader, start=2)]
    except (OSError, UnicodeDecodeError) as error:
        raise EvaluationError(f"{path}: cannot be read as a table of outcomes: {error}") from error


_COLUMNS = tuple(field.name for field in fields(Outcome))


def _row(outcome: Outcome) -> Row:
    row: Row = {}
    for name in _COLUMNS:
        value = getattr(outcome, name)
        row[name] = (
            int(value) if isinstance(value, bool) else round(value, _DIGITS) if isinstance(value, float) else value
        )
    return row


def _parsed(row: dict[str, str], where: str) -> Outcome:
    try:
        return Outcome(
            group=row["group"],
            source=row["source"],
            fault=row["fault"],
            seed=int(row["seed"]),
            error_m=float(row["error_m"]),
            odometry_m=float(row["odometry_m"]),
            given_m=_optional(row["given_m"]),
            usual_m=float(row["usual_m"]),
            is_said=bool(int(row["is_said"])),
            nees=_optional(row["nees"]),
            cpu_s=float(row["cpu_s"]),
        )
    except (TypeError, ValueError) as error:
        raise EvaluationError(f"{where}: found a row that is no outcome, expected numbers: {error}") from error


def _optional(word: str) -> float | None:
    return float(word) if word else None
