"""The experiments of Taleghani et al., *ICE Matching*, ICTAI 2010, and the figures that it reports."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frontends.dp_slam import DpSlamConfig, dp_slam
from frontends.scan import Log
from frontends.simulator.simulation import Simulation
from graph.se2 import between, compose
from iceg.config import Config
from iceg.dp_slam_results import occupancy_grid
from iceg.evaluation.bench.tables import Row
from iceg.evaluation.trajectory import TrajectoryErrors, trajectory_errors
from iceg.maps.grid import OccupancyGrid
from iceg.slam.pipeline import run


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperTimes:
    """A pair of rows of Table I: seconds for one log."""

    scans: int
    ice_s: float
    dp_slam_s: float


TABLE_1: Mapping[str, PaperTimes] = {
    "rooms": PaperTimes(scans=2126, ice_s=202.0, dp_slam_s=2122.0),
    "corridor": PaperTimes(scans=987, ice_s=88.0, dp_slam_s=711.0),
}
"""Table I, by the scene of ours that stands for the paper's log."""

FIGURE_7_MEAN_M = (0.4, 0.6)
"""Mean error along x and y that goes with Fig. 7 [m]."""
FIGURE_7_VARIANCE = (0.35, 0.5)
"""Variance of the error along x and y that goes with Fig. 7, of an unknown unit; [m²] is assumed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedRun:
    """What one method made of a log, and how long it took.

    Attributes:
        method: "ICE" or another matcher's name, or "DP-SLAM".
        log: the log.
        cpu_s: CPU time from the log in memory to trajectory and map [s].
        trajectory: (n, 3) T_map_robot of every scan.
        grid: its map.
        errors: against the truth, both laid over each other.
    """

    method: str
    log: Log
    cpu_s: float
    trajectory: NDArray[np.float64]
    grid: OccupancyGrid
    errors: TrajectoryErrors

    @property
    def scans_per_second(self) -> float:
        """Scans per second of CPU time."""
        return len(self.log) / self.cpu_s


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisErrors:
    """Errors of a trajectory that starts where the truth starts; nothing is fitted.

    Attributes:
        errors: (n, 2) along x and y of the world [m].
    """

    errors: NDArray[np.float64]

    @property
    def mean_absolute(self) -> NDArray[np.float64]:
        """(2,) along x and y [m]."""
        return np.asarray(np.abs(self.errors).mean(axis=0))

    @property
    def variance(self) -> NDArray[np.float64]:
        """(2,) along x and y [m²]."""
        return np.asarray(self.errors.var(axis=0))


def first_scans(simulation: Simulation, n: int | None) -> Simulation:
    """The first n scans of a simulation; all of them for None."""
    log = simulation.log
    part = replace(log, ranges=log.ranges[:n], odometry=log.odometry[:n], stamps=log.stamps[:n])
    return replace(simulation, log=part, truth=simulation.truth[:n])


def time_run(simulation: Simulation, config: Config | None = None) -> TimedRun:
    """Our pipeline on a simulated log, with the matcher that the settings name."""
    config = config or Config()
    started = time.process_time()
    result = run(simulation.log, config)
    return TimedRun(
        method=config.matcher.upper(),
        log=simulation.log,
        cpu_s=time.process_time() - started,
        trajectory=result.trajectory,
        grid=result.grid,
        errors=trajectory_errors(result.trajectory, simulation.truth),
    )


def time_dp_slam(
    simulation: Simulation, config: DpSlamConfig | None = None, progress: Callable[[int, int], None] | None = None
) -> TimedRun:
    """DP-SLAM on the same log, with its authors' settings unless others are given."""
    started = time.process_time()
    result = dp_slam(simulation.log, config, progress)
    return TimedRun(
        method="DP-SLAM",
        log=simulation.log,
        cpu_s=time.process_time() - started,
        trajectory=result.trajectory,
        grid=occupancy_grid(result),
        errors=trajectory_errors(result.trajectory, simulation.truth),
    )


def times_row(scene: str, ice: TimedRun, other: TimedRun) -> Row:
    """A line of Table I: our times beside the paper's."""
    paper = TABLE_1[scene]
    return {
        "log": scene,
        "scans": len(ice.log),
        "ICE [s]": ice.cpu_s,
        "DP-SLAM [s]": other.cpu_s,
        "ratio": other.cpu_s / ice.cpu_s,
        "ICE scans/s": ice.scans_per_second,
        "paper: scans": paper.scans,
        "paper: ICE [s]": paper.ice_s,
        "paper: DP-SLAM [s]": paper.dp_slam_s,
        "paper: ratio": paper.dp_slam_s / paper.ice_s,
        "paper: ICE scans/s": paper.scans / paper.ice_s,
    }


def quality_row(timed: TimedRun) -> Row:
    """What a picture of a map shows, in numbers."""
    return {
        "method": timed.method,
        "ATE [m]": timed.errors.ate_rmse,
        "largest [m]": timed.errors.ate_max,
        "heading [°]": float(np.degrees(timed.errors.rot_rmse)),
        "CPU [s]": timed.cpu_s,
        "scans/s": timed.scans_per_second,
    }


def axis_errors(trajectory: NDArray[np.float64], truth: NDArray[np.float64]) -> AxisErrors:
    """Errors along the axes of the world when the first pose is laid on the first true one, as in Fig. 7.

    Args:
        trajectory: (n, 3) T_map_robot.
        truth: (n, 3) T_world_robot of the same scans.
    """
    return AxisErrors(errors=(laid_on_start(trajectory, truth) - truth)[:, :2])


def laid_on_start(trajectory: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) the trajectory in the frame of the truth, their first poses being the same."""
    return compose(truth[0], between(trajectory[0], trajectory))
