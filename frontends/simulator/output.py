"""What a simulation leaves behind: the log in CARMEN's format and the truth."""

import gzip
import io
from pathlib import Path

import numpy as np

from frontends.scan import Log
from frontends.simulator.files import write_atomically
from frontends.simulator.simulation import Simulation
from graph.se2 import compose

_NO_RETURN = 81.83


def write_simulation(directory: Path, simulation: Simulation) -> None:
    """Write `log.clf` and `truth.csv` into a folder, made if it is not there."""
    directory.mkdir(parents=True, exist_ok=True)
    write_carmen(directory / "log.clf", simulation.log)
    write_truth(directory / "truth.csv", simulation)


def write_truth(path: Path, simulation: Simulation) -> None:
    """Write the true poses T_map_robot as CSV: `t_s,x_m,y_m,theta_rad`, one row per scan."""
    table = io.StringIO()
    rows = np.column_stack([simulation.log.stamps, simulation.truth])
    formats = ("%.3f", "%.6f", "%.6f", "%.6f")
    np.savetxt(table, rows, fmt=formats, delimiter=",", comments="", header="t_s,x_m,y_m,theta_rad")
    write_atomically(path, table.getvalue().encode())


def write_carmen(path: Path, log: Log) -> None:
    """Write FLASER lines; compressed when the name ends in `.gz`, the same bytes for the same log."""
    T_odom_laser = compose(log.odometry, log.geometry.T_robot_laser)
    ranges = np.where(np.isfinite(log.ranges), log.ranges, _NO_RETURN)
    lines = ["# FLASER num_readings [ranges, right to left] x y theta odom_x odom_y odom_theta stamp host stamp"]
    for scan, laser, robot, stamp in zip(ranges, T_odom_laser, log.odometry, log.stamps, strict=True):
        poses = " ".join(f"{value:.6f}" for value in (*laser, *robot))
        lines.append(f"FLASER {len(scan)} {' '.join(f'{r:.2f}' for r in scan)} {poses} {stamp:.6f} sim {stamp:.6f}")
    content = ("\n".join(lines) + "\n").encode()
    write_atomically(path, gzip.compress(content, 9, mtime=0) if path.suffix == ".gz" else content)
