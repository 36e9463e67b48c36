"""A process that compiles what some matchers of the literature call: `python -m tests.rival_kernels NAME ...`.

Each runs the pipeline over a few scans. Those in one process share what they call.
"""

import gc
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from typing import cast

from frontends.simulator.simulation import simulate
from iceg.config import Config, MatcherName
from iceg.evaluation.paper import first_scans
from iceg.pipeline import run

_TOGETHER: Sequence[Sequence[MatcherName]] = (("icp", "plicp", "idc", "mbicp", "csm"), ("wsm", "qwsm", "ndt"))
"""About as much work each."""
_SCANS = 25


def compile_rivals() -> None:
    """Compile in two processes what all of them call; hardly a second longer than it takes to look where that is done.

    Raises:
        subprocess.CalledProcessError: one of them does not run.
    """
    with ExitStack() as running:
        commands = [[sys.executable, "-m", "tests.rival_kernels", *names] for names in _TOGETHER]
        for process in [running.enter_context(subprocess.Popen(command)) for command in commands]:
            if process.wait():
                raise subprocess.CalledProcessError(process.returncode, process.args)


def main(names: Sequence[str]) -> None:
    """Run each matcher named."""
    gc.disable()  # a sixth of the time to compile would go into looking for garbage
    log = first_scans(simulate("room", seed=3), _SCANS).log
    for name in names:
        run(log, Config(matcher=cast("MatcherName", name)))


if __name__ == "__main__":
    main(sys.argv[1:])
