"""The logs of the benchmark and what each is judged by."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.judge import reference_report, relations_csv_report, truth_report

Judge = Callable[[Path, Path], dict[str, float]]

_PUBLIC = ("intel", "mit-csail", "aces", "mrpt-simul")
_JUDGES: tuple[tuple[str, Judge], ...] = (
    ("relations.csv", relations_csv_report),
    ("truth.csv", truth_report),
    ("reference.csv", reference_report),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchLog:
    """A log with what is known about it.

    Attributes:
        name: in the tables.
        path: the log.
        known: the best there is: relations, else the truth, else a reference; None when there is nothing.
    """

    name: str
    path: Path
    known: Path | None

    @classmethod
    def at(cls, path: Path) -> "BenchLog":
        """The log at a path, judged by the best that lies beside it."""
        known = next(iter(known_beside(path).values()), None)
        return cls(name=_stem(path), path=path, known=None if known is None else Path(known))

    @property
    def relations(self) -> Path | None:
        """The benchmark's relations, where there are any."""
        return self.known if self.known is not None and self.known.name.endswith("relations.csv") else None

    def judge(self, folder: Path) -> dict[str, float]:
        """Figures of a run of this log, by their published names; empty when nothing is known."""
        if self.known is None:
            return {}
        judge = next(judge for ending, judge in _JUDGES if self.known.name.endswith(ending))
        return judge(folder, self.known)


def known_beside(log: Path) -> dict[str, str]:
    """The best that is known of a log, by the names of the files beside it: `NAME.relations.csv` and its kin.

    Returns:
        Kind and path of the first of relations, truth and reference that exists; empty when there is none.
    """
    for file in possible_beside(log):
        if file.exists():
            return {file.name.split(".")[-2]: str(file)}
    return {}


def possible_beside(log: Path) -> list[Path]:
    """The files that may tell something about a log, the best first."""
    return [log.with_name(f"{_stem(log)}.{ending}") for ending, _ in _JUDGES]


def folder_of_logs(given: Path | None) -> Path | None:
    """The folder of public logs: the one given, else the one that `ICEG_DATA` names; None when that is not there.

    Raises:
        EvaluationError: the one given is no folder.
    """
    if given is not None and not given.is_dir():
        raise EvaluationError(f"{given}: is no folder, expected one with public logs")
    named = given or (Path(os.environ["ICEG_DATA"]) if os.environ.get("ICEG_DATA") else None)
    return named if named is not None and named.is_dir() else None


def find_logs(data: Path | None) -> list[BenchLog]:
    """The embedded log and those of the public ones that are at hand.

    Args:
        data: the folder of public logs, `NAME.clf.gz` with `NAME.relations.csv`, `NAME.truth.csv` or
            `NAME.reference.csv` beside them; None for the embedded log alone.

    Returns:
        The embedded log first.
    """
    logs = [BenchLog(name="office (embedded)", path=demo_log_path(), known=demo_truth_path())]
    if data is None:
        return logs
    public = [data / f"{name}.clf.gz" for name in _PUBLIC]
    return [*logs, *(BenchLog.at(path) for path in public if path.exists())]


def _stem(log: Path) -> str:
    """The name of a log without its endings, which may be several."""
    return log.name.partition(".")[0]
