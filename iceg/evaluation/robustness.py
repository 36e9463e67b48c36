"""What faults of robot, laser and recorder do to a run: each log with one fault at a time, against what is true."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from iceg.config import Config
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.bench.tables import Row, write_csv
from iceg.evaluation.degradation import DEGRADATIONS, Degraded
from iceg.evaluation.trajectory import check_one_row_per_scan, read_truth_csv, trajectory_errors
from iceg.maps.config import GridConfig
from iceg.pipeline import run
from iceg.run_result.slam_result import SlamResult

_CONFIG = Config(grid=GridConfig(resolution=0.5))
_RUINED_M, _RUINED_FACTOR = 0.3, 5.0
"""A run is ruined whose error exceeds this [m] and so many times that without the fault."""


def write_faults(logs: Sequence[BenchLog], output: Path, faults: Sequence[str] = ()) -> Iterator[Row]:
    """Run every log with every fault; the rows are kept as CSV.

    Args:
        logs: what to run; one without `NAME.truth.csv` is judged by its own run without faults.
        output: folder of `robustness.csv`, made if missing.
        faults: names out of `DEGRADATIONS`; all when left out.

    Yields:
        One row a run, as it ends.
    """
    output.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for log in logs:
        for row in _rows(log, faults or tuple(DEGRADATIONS)):
            rows.append(row)
            write_csv(rows, output / "robustness.csv")
            yield row


def _rows(log: BenchLog, faults: Sequence[str]) -> Iterator[Row]:
    recorded = read_log(log.path)
    clean = run(recorded, _CONFIG)
    truth = _truth(log, recorded, clean)
    whole = Degraded(log=recorded, scans=np.arange(len(recorded)))
    known = set(clean.summary["warnings"])
    first = _row(log.name, "none", whole, clean, truth, known)
    yield first
    usual = first["ATE [m]"]
    assert isinstance(usual, float)
    for fault in faults:
        degraded = DEGRADATIONS[fault](recorded)
        yield _row(log.name, fault, degraded, run(degraded.log, _CONFIG), truth, known, usual=usual)


def _truth(log: BenchLog, recorded: Log, clean: SlamResult) -> NDArray[np.float64]:
    """(n_scans, 3) the truth, or the run without faults."""
    if log.known is None or not log.known.name.endswith("truth.csv"):
        return clean.trajectory
    truth = read_truth_csv(log.known)
    check_one_row_per_scan(recorded.odometry, truth, log.known)
    return truth


def _row(
    name: str,
    fault: str,
    degraded: Degraded,
    result: SlamResult,
    truth: NDArray[np.float64],
    known: set[str],
    *,
    usual: float = 0.0,
) -> Row:
    """One run against the truth; what it warns of beyond `known`, and beyond the recording, is said."""
    errors = trajectory_errors(result.trajectory, truth[degraded.scans])
    told = [warning for warning in result.summary["warnings"] if warning not in known]
    said = bool(result.summary["lost_at_scans"]) or not set(told).issubset(result.log.warnings)
    is_ruined = errors.ate_rmse > max(_RUINED_M, _RUINED_FACTOR * usual)
    return {
        "log": name,
        "fault": fault,
        "scans": len(degraded.log),
        "ATE [m]": float(errors.ate_rmse),
        "verdict": ("ruined, and says so" if said else "ruined") if is_ruined else "sane",
        "carried by odometry": result.summary["scans_carried_by_odometry"],
        "lost": len(result.summary["lost_at_scans"]),
        "odometry breaks": len(result.summary["odometry_breaks_at_scans"]),
        "warnings": "; ".join(told),
    }
