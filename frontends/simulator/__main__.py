"""`python -m frontends.simulator SCENE -o DIR [--seed N]`: drive through a scene, write the logs and the truth."""

from pathlib import Path
from typing import Annotated

import tyro

from frontends.simulator.output import write_simulation
from frontends.simulator.simulation import simulate


def main(
    scene: tyro.conf.Positional[str], *, output: Annotated[Path, tyro.conf.arg(aliases=["-o"])], seed: int = 0
) -> None:
    """Drive through a scene and write the log and its truth.

    Args:
        scene: a name out of `SCENES`, or the path of a .world file.
        output: folder to write into.
        seed: of all that is random.
    """
    write_simulation(output, simulate(scene, seed))


if __name__ == "__main__":
    tyro.cli(main)
