"""Makes the embedded log anew: `python -m iceg.demo.make [FOLDER]`."""

import sys
from pathlib import Path

from frontends.logs.carmen import write_carmen
from frontends.simulator.output import write_truth
from frontends.simulator.simulation import Simulation, simulate
from iceg.demo import demo_log_path, demo_truth_path

SCENE, SEED = "office", 1


def simulate_demo() -> Simulation:
    """The simulation whose log and truth are embedded."""
    return simulate(SCENE, SEED)


def write_demo(folder: Path) -> None:
    """Write the log and its truth into a folder under the names they have in the package."""
    simulation = simulate_demo()
    write_carmen(folder / demo_log_path().name, simulation.log, range_decimals=2)
    write_truth(folder / demo_truth_path().name, simulation)


if __name__ == "__main__":
    write_demo(Path(sys.argv[1]) if len(sys.argv) > 1 else demo_log_path().parent)
