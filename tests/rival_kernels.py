"""A process that compiles what some matchers of the literature call: `python -m tests.rival_kernels NAME ...`.

Each runs the pipeline over a few scans. Those in one process share what they call.
"""

import gc
import sys
from collections.abc import Sequence
from typing import cast

from frontends.simulator.simulation import simulate
from iceg.config import Config, MatcherName
from iceg.evaluation.paper import first_scans
from iceg.pipeline import run

_SCANS = 25


def main(names: Sequence[str]) -> None:
    """Run each matcher named."""
    gc.disable()  # a sixth of the time to compile would go into looking for garbage
    log = first_scans(simulate("room", seed=3), _SCANS).log
    for name in names:
        run(log, Config(matcher=cast("MatcherName", name)))


if __name__ == "__main__":
    main(sys.argv[1:])
