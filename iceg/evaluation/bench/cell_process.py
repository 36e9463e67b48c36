"""The inside of the process that makes one run: a cell on its standard input, its results into the folder named."""

import math
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.atomic import write_atomically
from graph.errors import IcegError
from iceg.evaluation.bench.cell import Cell
from iceg.evaluation.bench.methods import Estimate, Method
from iceg.evaluation.bench.outcome import FIGURES_FILE, TRAJECTORY_FILE, Figures, format_figures
from iceg.memory import peak_memory_mb

_WARM_UP_SCANS = 40


def run_cell(cell: Cell, folder: Path) -> Figures:
    """Read or simulate the log, run the method, write its trajectory, judge it.

    Speed is that of the method alone, with kernels already loaded: neither start nor reading nor judging counts.

    Args:
        cell: what to run.
        folder: where `trajectory.tum` goes.

    Returns:
        Accuracy under the published names, and cost.

    Raises:
        IcegError: the log, the settings or what the run is judged by is not as expected.
    """
    from iceg.tum import format_tum

    method = cell.make()
    log = load_log(cell, method)
    _load_kernels(method, log)
    wall, cpu = time.perf_counter(), time.process_time()
    estimate = method.run(log)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    write_atomically(folder / TRAJECTORY_FILE, format_tum(log.stamps, estimate.trajectory).encode())
    return {
        "scans": len(log),
        **judge(cell, log, estimate),
        **estimate.counts,
        "cpu_s": cpu,
        "wall_s": wall,
        "scans_per_cpu_s": len(log) / max(cpu, 1e-9),
        "peak_memory_mb": peak_memory_mb() or math.nan,
    }


def load_log(cell: Cell, method: Method) -> Log:
    """The recorded log, or the simulated one together with its truth."""
    from dataclasses import asdict

    if cell.log.scene is None:
        from frontends.logs import read_log

        return read_log(Path(cell.log.path), **asdict(method.config.log))
    from frontends.simulator.simulation import simulate

    simulation = simulate(cell.log.scene, cell.seed)
    return replace(simulation.log, truth=simulation.truth)


def judge(cell: Cell, log: Log, estimate: Estimate) -> Figures:
    """Errors against everything that is known of the log; the number of comparisons under a name of its own for each.

    Raises:
        IcegError: what is known does not belong to the log.
    """
    from iceg.evaluation.relations import read_relations_csv
    from iceg.evaluation.report import relations_report, trajectory_report
    from iceg.evaluation.trajectory import poses_of_scans, read_reference_csv, trajectory_errors

    figures: Figures = {}
    if cell.log.relations is not None:
        report = relations_report(estimate.trajectory, read_relations_csv(Path(cell.log.relations)))
        figures |= {"relations": report.pop("n"), **report}
    if cell.log.reference is not None:
        scans, T_world_robot = read_reference_csv(Path(cell.log.reference))
        estimated = poses_of_scans(estimate.trajectory, scans, Path(cell.log.reference))
        report = trajectory_report(trajectory_errors(estimated, T_world_robot))
        figures |= {"poses": report.pop("n"), **report}
    truth = _truth(cell, log, estimate)
    if truth is not None:
        report = trajectory_report(trajectory_errors(estimate.trajectory, truth))
        figures |= {"poses": report.pop("n"), **report, **_honesty(estimate, truth)}
    return figures


def _truth(cell: Cell, log: Log, estimate: Estimate) -> NDArray[np.float64] | None:
    """The truth named in the experiment; else, when no reference is named, that which the log itself holds."""
    from iceg.evaluation.trajectory import check_one_row_per_scan, read_truth_csv

    if cell.log.truth is None:
        return log.truth if cell.log.reference is None else None
    truth = read_truth_csv(Path(cell.log.truth))
    check_one_row_per_scan(estimate.trajectory, truth, Path(cell.log.truth))
    return truth


def _honesty(estimate: Estimate, truth: NDArray[np.float64]) -> Figures:
    """NEES of the key poses, where there are covariances."""
    from iceg.evaluation.consistency import consistency, pose_nees
    from iceg.evaluation.report import consistency_report

    keys = estimate.key_poses
    if keys is None or len(keys.scans) < 2:
        return {}
    return consistency_report(consistency(pose_nees(keys.poses, truth[keys.scans], keys.covariances)))


def _load_kernels(method: Method, log: Log) -> None:
    """Run the first scans, so that compiling kernels, or loading compiled ones, is not timed."""
    with suppress(IcegError):
        method.run(log.select(slice(_WARM_UP_SCANS)))


def main() -> int:
    """Run the cell on standard input; results go to the folder that is the only argument."""
    folder = Path(sys.argv[1])
    try:
        figures = run_cell(Cell.from_json(sys.stdin.read()), folder)
    except IcegError as err:
        sys.stderr.write(f"{' '.join(str(err).split())}\n")
        return 1
    finite = {name: value for name, value in figures.items() if math.isfinite(value)}
    write_atomically(folder / FIGURES_FILE, format_figures(finite))
    return 0


if __name__ == "__main__":
    sys.exit(main())
