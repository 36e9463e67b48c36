"""Where the runs are made: in processes on this machine, or on a Dask cluster; each in a fresh process of its own.

What happens inside a run, a crash included, thus ends with that run, and time and memory are those of it alone.
"""

import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from iceg.evaluation.bench.cell import Cell
from iceg.evaluation.bench.outcome import FIGURES_FILE, TRAJECTORY_FILE, Outcome, failed, parse_figures
from iceg.evaluation.bench.runs import ONE_CORE
from iceg.evaluation.errors import EvaluationError

_CONNECT_TIMEOUT = 60
_INTERRUPTED = 130


def run_here(cells: Sequence[Cell], workers: int, time_limit_s: float | None = None) -> Iterator[Outcome]:
    """Run cells on this machine.

    Args:
        cells: what to run.
        workers: how many at a time.
        time_limit_s: for each [s].

    Yields:
        Outcomes in the order in which they are complete.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_end_on_interrupt) as pool:
        futures = {pool.submit(_attempt_in_pool, cell, time_limit_s): cell for cell in cells}
        try:
            for future in as_completed(futures):
                error = future.exception()
                yield future.result() if error is None else failed(futures[future], f"{type(error).__name__}: {error}")
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def run_on_dask(cells: Sequence[Cell], scheduler: str, time_limit_s: float | None = None) -> Iterator[Outcome]:
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


def attempt(cell: Cell, time_limit_s: float | None = None) -> Outcome:
    """Run a cell in a fresh process on one core.

    Args:
        cell: what to run.
        time_limit_s: the process is ended after that [s].

    Returns:
        What it found, or why it failed.
    """
    command = [sys.executable, "-m", "iceg.evaluation.bench.cell_process"]
    with tempfile.TemporaryDirectory(prefix="iceg-bench-") as name:
        try:
            done = subprocess.run(
                [*command, name],
                input=cell.to_json(),
                env=os.environ | ONE_CORE,
                capture_output=True,
                encoding="utf-8",
                timeout=time_limit_s,
                check=False,
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


def _end_on_interrupt() -> None:
    """Let Ctrl-C end a worker without a traceback."""
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, lambda *_: sys.exit(_INTERRUPTED))


def _attempt_in_pool(cell: Cell, time_limit_s: float | None) -> Outcome:
    """`attempt`; when interrupted its files are removed and the worker ends, lest it go on with the next cell."""
    try:
        return attempt(cell, time_limit_s)
    except SystemExit:
        os._exit(_INTERRUPTED)
