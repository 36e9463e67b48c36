"""Where the runs are made: several at a time on this machine, or on a Dask cluster; each in a fresh process of its own.

What happens inside a run, a crash included, thus ends with that run, and time and memory are those of it alone.
"""

import signal
import subprocess
import tempfile
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from pathlib import Path

from iceg.evaluation.bench.cell import Cell
from iceg.evaluation.bench.child_process import Children
from iceg.evaluation.bench.held_signals import held_back
from iceg.evaluation.bench.outcome import FIGURES_FILE, TRAJECTORY_FILE, Outcome, failed, parse_figures
from iceg.evaluation.bench.runs import ONE_CORE
from iceg.evaluation.errors import EvaluationError

_CONNECT_TIMEOUT = 60
_LISTEN_S = 0.1
"""So often a signal is listened for that tells the benchmark to end."""
_CELL_PROCESS = "iceg.evaluation.bench.cell_process"


def run_here(cells: Sequence[Cell], workers: int, time_limit_s: float | None = None) -> Generator[Outcome, None, None]:
    """Run cells on this machine.

    Args:
        cells: what to run.
        workers: how many at a time.
        time_limit_s: for each [s].

    Yields:
        Outcomes in the order in which they are complete.
    """
    with held_back() as deliver:
        children, pool = Children(), ThreadPoolExecutor(workers)
        try:
            cell_of = {pool.submit(attempt, cell, time_limit_s, children): cell for cell in cells}
            pending = set(cell_of)
            while pending:
                done, pending = wait(pending, _LISTEN_S, FIRST_COMPLETED)
                for future in done:
                    error = future.exception()
                    cell = cell_of[future]
                    yield future.result() if error is None else failed(cell, f"{type(error).__name__}: {error}")
                deliver()  # complete runs are kept
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            children.end()
            pool.shutdown()


def run_on_dask(
    cells: Sequence[Cell], scheduler: str, time_limit_s: float | None = None
) -> Generator[Outcome, None, None]:
    """Run cells on the workers of a Dask cluster.

    Its workers need this version of iceg, and see the logs under the same paths.

    Args:
        cells: what to run.
        scheduler: address of the cluster's scheduler, such as tcp://127.0.0.1:8786.
        time_limit_s: for each [s].

    Yields:
        Outcomes in the order in which they are complete.

    Raises:
        EvaluationError: Dask is not installed, or there is no scheduler at the address.
    """
    try:
        from distributed import Client
        from distributed import as_completed as dask_as_completed
    except ImportError as err:
        raise EvaluationError("a cluster needs Dask: pip install 'iceg[bench]'") from err
    try:
        client = Client(scheduler, timeout=_CONNECT_TIMEOUT)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as err:
        raise EvaluationError(f"{scheduler}: no Dask scheduler answers there: {err}") from err
    with client:
        futures = {client.submit(attempt, cell, time_limit_s, pure=False): cell for cell in cells}
        for future in dask_as_completed(list(futures)):  # type: ignore[no-untyped-call]
            cell = futures.pop(future)
            error = future.exception()
            yield future.result() if error is None else failed(cell, f"{type(error).__name__}: {error}")
            future.release()


def attempt(cell: Cell, time_limit_s: float | None = None, children: Children | None = None) -> Outcome:
    """Run a cell in a fresh process on one core.

    Args:
        cell: what to run.
        time_limit_s: the process is ended after that [s].
        children: processes it is to be ended with.

    Returns:
        What it found, or why it failed.
    """
    with tempfile.TemporaryDirectory(prefix="iceg-bench-") as name:
        try:
            done = (children or Children()).run(
                _CELL_PROCESS, [name], ONE_CORE, given=cell.to_json(), time_limit_s=time_limit_s
            )
        except subprocess.TimeoutExpired:
            return failed(cell, f"stopped after the time limit of {time_limit_s:g} s")
        if done.returncode != 0:
            return failed(cell, _reason(done))
        folder = Path(name)
        return Outcome(
            cell=cell,
            figures=parse_figures((folder / FIGURES_FILE).read_bytes()),
            trajectory=(folder / TRAJECTORY_FILE).read_bytes(),
        )


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    if done.returncode < 0:
        return f"ended by signal {-done.returncode} ({signal.strsignal(-done.returncode)})"
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"ended with code {done.returncode}"
