"""The experiments of Taleghani et al., *ICE Matching*, ICTAI 2010, and the figures that it reports."""

import time
from collections.abc import Callable, Mapping, Sequence
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
from iceg.pipeline import run


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

FIGURES_3_AND_4: Mapping[tuple[str, str], str] = {
    ("rooms", "DP-SLAM"): "satisfactory",
    ("rooms", "ICE"): "satisfactory",
    ("corridor", "DP-SLAM"): "a part turned after the corridor",
    ("corridor", "ICE"): "preferable",
}
"""What the paper says of the maps of Figs. 3 and 4, which it shows without numbers, by scene and method."""

FIGURE_6: Mapping[str, Row] = {
    "ICE": {"the paper: map": "best", "the paper: time": "least"},
    "QWSM": {"the paper: map": "acceptable, a shift", "the paper: time": "close"},
    "IDC": {"the paper: map": "unpleasant", "the paper: time": "close"},
    "MbICP": {"the paper: map": "unpleasant", "the paper: time": "most"},
}
"""What the paper says of Fig. 6, without numbers, by method."""

FIGURE_7: Row = {
    "run": "the paper",
    "first pose fixed, x: mean [m]": 0.4,
    "first pose fixed, y: mean [m]": 0.6,
    "first pose fixed, x: variance [cm²]": 3500.0,
    "first pose fixed, y: variance [cm²]": 5000.0,
}
"""The errors that go with Fig. 7; their variances, 0.35 and 0.5, have no unit there: m² is assumed."""


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
    return replace(simulation, log=simulation.log.select(slice(n)), truth=simulation.truth[:n])


def time_run(simulation: Simulation, config: Config | None = None) -> TimedRun:
    """Our pipeline on a simulated log, with the matcher that the settings name."""
    config = config or Config()
    started = time.process_time()
    result = run(simulation.log, config)
    return TimedRun(
        method="MbICP" if config.matcher == "mbicp" else config.matcher.upper(),
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


def axis_row(run: str, fitted: TrajectoryErrors, fixed: AxisErrors) -> Row:
    """A line beside Fig. 7: errors along x and y, the trajectory fitted to the truth, and with its first pose fixed."""
    return {
        "run": run,
        "first pose fixed, x: mean [m]": float(fixed.mean_absolute[0]),
        "first pose fixed, y: mean [m]": float(fixed.mean_absolute[1]),
        "first pose fixed, x: variance [cm²]": 1e4 * float(fixed.variance[0]),
        "first pose fixed, y: variance [cm²]": 1e4 * float(fixed.variance[1]),
        "fitted, x: mean [m]": fitted.x_mean_abs,
        "fitted, y: mean [m]": fitted.y_mean_abs,
        "fitted, x: variance [cm²]": 1e4 * fitted.x_var,
        "fitted, y: variance [cm²]": 1e4 * fitted.y_var,
    }


def mean_row(rows: Sequence[Row]) -> Row:
    """The mean of each column of figures."""
    figures = [name for name, value in rows[0].items() if isinstance(value, float)]
    return {"run": f"mean of {len(rows)}"} | {
        name: float(np.mean([float(row[name] or 0.0) for row in rows])) for name in figures
    }


def laid_on_start(trajectory: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) the trajectory in the frame of the truth, their first poses being the same."""
    return compose(truth[0], between(trajectory[0], trajectory))
