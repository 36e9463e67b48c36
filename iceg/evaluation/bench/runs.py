"""Whole runs, each in a fresh process on one core, judged by what they leave on disk."""

import resource
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iceg.evaluation.bench.child_process import Children
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.bench.tables import Row
from iceg.evaluation.errors import EvaluationError
from iceg.results import read_summary

MODES: dict[str, tuple[str, ...]] = {
    "default": (),
    "no loops": ("--loops.no-enabled",),
    "matching alone": ("--loops.no-enabled", "--finish.no-enabled"),
}
"""Flags of each mode: as it comes; no place is found again; the same without the offline finish."""
ONE_CORE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of a process that is to stay on one core."""
_COMPILED = {"PYTHONDONTWRITEBYTECODE": ""}
"""Byte code may be kept, as it is where iceg is installed: what is timed is not Python's compiler."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedRun:
    """What `iceg run` left behind and what it took.

    Attributes:
        folder: its results.
        wall_s: from start to end of the process [s].
        cpu_s: processor time, user and system [s].
    """

    folder: Path
    wall_s: float
    cpu_s: float


def run_in_fresh_process(log: Path, folder: Path, flags: Sequence[str] = ()) -> TimedRun:
    """`iceg run LOG -o FOLDER`, timed from outside.

    Raises:
        EvaluationError: it failed.
    """
    words = ["run", str(log), "-o", str(folder), "--overwrite", *flags]
    before, started = _cpu_of_children(), time.perf_counter()
    done = Children().run("iceg", words, ONE_CORE | _COMPILED)
    wall, cpu = time.perf_counter() - started, _cpu_of_children() - before
    if done.returncode != 0:
        raise EvaluationError(f"iceg {' '.join(words)} failed: {' '.join(done.stderr.split())}")
    return TimedRun(folder=folder, wall_s=wall, cpu_s=cpu)


def accuracy_and_speed(log: BenchLog, mode: str, output: Path) -> tuple[Row, Row]:
    """Run one log in one mode.

    Args:
        log: the log.
        mode: a key of `MODES`.
        output: parent of the folder of results.

    Returns:
        A row of the table of accuracy and one of the table of speed.
    """
    run = run_in_fresh_process(
        log.path, output / f"{log.path.name.split('.')[0]}-{mode.replace(' ', '-')}", MODES[mode]
    )
    summary, figures = read_summary(run.folder), log.judge(run.folder)
    head: Row = {"log": log.name, "mode": mode, "scans": summary["scans"]}
    return head | _accuracy(summary, figures), head | _speed(summary, run)


def _accuracy(summary: dict[str, Any], figures: dict[str, float]) -> Row:
    tried = max(1, summary["scans"] - 1)
    return {
        "key poses": summary["key_poses"],
        "closures": summary["closures"]["accepted"],
        "ICE accepted [%]": 100.0 * (1.0 - summary["scans_carried_by_odometry"] / tried),
        "relations mean [m]": figures.get("trans_mean"),
        "median [m]": figures.get("trans_median"),
        "rotation mean [°]": figures.get("rot_mean_deg"),
        "ATE [m]": figures.get("ate_rmse"),
        "heading [°]": figures.get("rot_rmse_deg"),
        "NEES mean": figures.get("nees_mean"),
        "NEES in 95 % region": figures.get("nees_share_95"),
    }


def _speed(summary: dict[str, Any], run: TimedRun) -> Row:
    scans, inside = summary["scans"], cpu_by_stage(summary)
    return {
        "scans/s": round(scans / run.wall_s),
        "scans/CPU s": round(scans / run.cpu_s),
        "CPU [s]": run.cpu_s,
        "wall [s]": run.wall_s,
        "peak memory [MB]": summary["peak_memory_mb"],
        "start and reading [s]": run.cpu_s - sum(inside.values()),
        **{f"{stage.replace('_', ' ')} [s]": seconds for stage, seconds in inside.items()},
    }


def cpu_by_stage(summary: Mapping[str, Any]) -> dict[str, float]:
    """Processor time of each stage of a run [s], writing included, from its summary."""
    return {**summary["cpu_seconds"], "writing": sum(summary["writing_cpu_s"].values())}


def _cpu_of_children() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
