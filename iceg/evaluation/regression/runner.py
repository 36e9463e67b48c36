"""Running cells: all of one recording together, since faults are judged by the run without them."""

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.errors import IcegError
from iceg.config import Config
from iceg.evaluation.consistency import pose_nees
from iceg.evaluation.degradation import DEGRADATIONS, Degraded
from iceg.evaluation.regression.cells import NO_FAULT, Cell
from iceg.evaluation.regression.outcome import Outcome
from iceg.evaluation.regression.recordings import Judge, Recording, recording_of, with_noise
from iceg.evaluation.regression.rules import switched_off
from iceg.evaluation.regression.verdict import is_said
from iceg.evaluation.trajectory import trajectory_errors
from iceg.maps.config import GridConfig
from iceg.pipeline import run
from iceg.run_result.slam_result import SlamResult

CONFIG = Config(grid=GridConfig(resolution=0.5))
"""The defaults, but for a grid that nobody looks at."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Cells of one recording.

    Attributes:
        cells: at least one, all of one source.
        data: folder of the public logs.
        rules: to be switched off, one at a time; "" for none.
    """

    cells: tuple[Cell, ...]
    data: Path | None
    rules: tuple[str, ...] = ("",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Clean:
    """The run of a recording as it is, which its faults are judged by.

    Attributes:
        trajectory: (n_scans, 3), the truth where nothing better is known.
        warnings: which it gives anyway.
        error: [m].
    """

    trajectory: NDArray[np.float64]
    warnings: frozenset[str]
    error: float

    def judge(self, scans: NDArray[np.int64]) -> Judge:
        """Of trajectories of a log that has only these scans left, (n,) indices."""
        against = self.trajectory[scans]
        return lambda T_map_robot: trajectory_errors(T_map_robot, against).ate_rmse


def tasks(cells: Sequence[Cell], data: Path | None, rules: Sequence[str] = ("",)) -> list[Task]:
    """The cells by recording."""
    by_recording = groupby(sorted(cells, key=_recording), key=_recording)
    return [Task(cells=tuple(group), data=data, rules=tuple(rules)) for _, group in by_recording]


def run_task(task: Task) -> list[tuple[str, list[Outcome]]]:
    """Run the cells of one recording, with every rule of the task switched off in turn.

    Returns:
        Rule and its outcomes, in the order of rules and cells.

    Raises:
        IcegError: the recording is not there, or a rule is not.
    """
    recording = recording_of(task.cells[0], task.data)
    found: list[tuple[str, list[Outcome]]] = []
    for rule in task.rules:
        if not rule:
            found.append((rule, list(outcomes(recording, task.cells))))
            continue
        with switched_off(rule) as changed:
            found.append((rule, list(outcomes(recording, task.cells, changed(CONFIG)))))
    return found


def outcomes(recording: Recording, cells: Sequence[Cell], config: Config = CONFIG) -> Iterator[Outcome]:
    """Run the cells of one recording.

    Args:
        recording: what they are made from.
        cells: all of them of this recording.
        config: of the runs.

    Yields:
        One outcome a cell, in their order.
    """
    clean = _clean(recording, config) if any(cell.fault != NO_FAULT for cell in cells) else None
    for cell in cells:
        noisy = with_noise(recording.log, cell.seed)
        degraded = Degraded(log=noisy, scans=np.arange(len(noisy)))
        if cell.fault != NO_FAULT:
            degraded = DEGRADATIONS[cell.fault](noisy)
        yield _outcome(cell, recording, degraded, clean, config)


def _recording(cell: Cell) -> tuple[bool, str]:
    return cell.is_simulated, cell.source


def _clean(recording: Recording, config: Config) -> Clean:
    result = run(recording.log, config)
    against = result.trajectory if recording.truth is None else recording.truth
    return Clean(
        trajectory=against,
        warnings=frozenset(result.summary["warnings"]),
        error=trajectory_errors(result.trajectory, against).ate_rmse,
    )


def _outcome(cell: Cell, recording: Recording, degraded: Degraded, clean: Clean | None, config: Config) -> Outcome:
    started = time.process_time()
    result = _run(degraded.log, cell, config)
    spent = time.process_time() - started
    trajectory = degraded.log.odometry if result is None else result.trajectory
    judge, usual = recording.judge, 0.0
    known = frozenset((degraded.log if result is None else result.log).warnings)
    if cell.fault != NO_FAULT and clean is not None:
        judge, usual, known = clean.judge(degraded.scans), clean.error, known | clean.warnings
    return Outcome(
        group=cell.group,
        source=cell.source,
        fault=cell.fault,
        seed=cell.seed,
        error_m=judge(trajectory),
        odometry_m=recording.odometry_error,
        given_m=judge(degraded.log.odometry) if degraded.log.has_odometry else None,
        usual_m=usual,
        is_said=result is None or is_said(result.summary, known),
        nees=None if result is None or recording.truth is None else _nees(result, recording.truth[degraded.scans]),
        cpu_s=spent,
    )


def _run(log: Log, cell: Cell, config: Config) -> SlamResult | None:
    """The run; None where it ends with an error, which leaves a person with the odometry, and told so."""
    try:
        return run(log, config)
    except (IcegError, RuntimeError, np.linalg.LinAlgError) as error:
        _log.warning("%s: %s", cell.name, error)
        return None


def _nees(result: SlamResult, truth: NDArray[np.float64]) -> float | None:
    """Mean over the key poses but the first."""
    if len(result.key_scans) < 2:
        return None
    return float(pose_nees(result.key_poses, truth[result.key_scans], result.covariances).mean())
