"""What a simulation leaves behind: the log in the formats of CARMEN and USARSim, and the truth."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from frontends.logs.carmen import write_carmen
from frontends.logs.errors import LogError
from frontends.logs.usarsim import write_usarsim
from frontends.simulator.simulation import Simulation
from frontends.simulator.world import SimulatorError
from graph.atomic import write_atomically
from graph.errors import reason
from graph.publish import publishing


def write_simulation(directory: Path, simulation: Simulation) -> None:
    """Write `log.clf`, `log.usarsim` and `truth.csv` into a folder, made if it is not there: all three or none.

    The USARSim log holds the truth as well, as that simulator's logs do.

    Raises:
        SimulatorError: the folder cannot be made, or the files not be written.
    """
    try:
        with publishing(directory) as folder:
            write_carmen(folder / "log.clf", simulation.log)
            write_usarsim(folder / "log.usarsim", replace(simulation.log, truth=simulation.truth))
            write_truth(folder / "truth.csv", simulation)
    except (OSError, LogError) as error:
        cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
        raise SimulatorError(f"{directory}: the simulation cannot be written ({reason(cause)})") from error


def write_truth(path: Path, simulation: Simulation) -> None:
    """Write the true poses T_map_robot as CSV: `t_s,x_m,y_m,theta_rad`, one row per scan."""
    table = io.StringIO()
    rows = np.column_stack([simulation.log.stamps, simulation.truth])
    formats = ("%.3f", "%.6f", "%.6f", "%.6f")
    np.savetxt(table, rows, fmt=formats, delimiter=",", comments="", header="t_s,x_m,y_m,theta_rad")
    write_atomically(path, table.getvalue().encode())
