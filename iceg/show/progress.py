"""What a run says while it runs: a progress bar, and a note when it compiles for the first time."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import RLock
from typing import NoReturn, Self

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from frontends.scan import Log
from iceg.slam.progress import Progress, Stage

_BAR_AT_FIRST = "{desc}: {percentage:3.0f}%|{bar:20}| {n_fmt}/{total_fmt} scans, {elapsed} gone{postfix}"
_BAR = _BAR_AT_FIRST.replace("{postfix}", ", {remaining} left{postfix}")
_READING = "{desc}: {percentage:3.0f}%|{bar:20}| {n_fmt}/{total_fmt} messages, {elapsed} gone"
_SHORT_READ_S = 1.0
_TELLING = 0.1
"""From this share of the scans on their mean time tells what is left: the first ones may wait a minute for kernels."""
_INTERVAL_ON_TERMINAL_S, _INTERVAL_IN_FILE_S = 0.1, 5.0

tqdm.set_lock(RLock())  # its own is for bars of several processes, and loads all of multiprocessing


class _Bar(tqdm):  # type: ignore[type-arg]
    """A bar without the thread that watches over bars: a process that has threads must not be copied."""

    monitor_interval = 0


class ProgressBar:
    """A bar on stderr for each stage: scans, time left, real-time factor, share of accepted matches. A context manager.

    Attributes:
        matching: where the matching of scans came to.
    """

    def __init__(self, log: Log, first_stage: Stage = "matching") -> None:
        self.matching = Progress(scans=0, tried=0, accepted=0, stage=first_stage)
        self._log = log
        self._interval = _INTERVAL_ON_TERMINAL_S if sys.stderr.isatty() else _INTERVAL_IN_FILE_S
        self._latest = self.matching
        self._started = self._shown = time.perf_counter()
        self._bar = self._new_bar()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._finish()

    def __call__(self, progress: Progress) -> None:
        """Show where the run stands; cheap when nothing is due."""
        if progress.stage != self._latest.stage:
            self._finish()
            self._latest = progress
            self._started = self._shown = time.perf_counter()
            self._bar = self._new_bar()
        self._latest = progress
        if progress.stage == "matching":
            self.matching = progress
        now = time.perf_counter()
        if now - self._shown >= self._interval or progress.scans == self._bar.total:
            self._shown = now
            self._bar.set_postfix_str(self._describe(progress, now), refresh=False)
        if progress.scans >= _TELLING * len(self._log):
            self._bar.bar_format = _BAR
        self._bar.update(progress.scans - self._bar.n)

    def _new_bar(self) -> "tqdm[NoReturn]":
        return _Bar(
            total=len(self._log),
            desc=f"{self._log.path.name}, {self._latest.stage}",
            bar_format=_BAR_AT_FIRST,
            smoothing=0,
            mininterval=self._interval,
            file=sys.stderr,
        )

    def _finish(self) -> None:
        self._bar.set_postfix_str(self._describe(self._latest, time.perf_counter()), refresh=False)
        self._bar.close()

    def _describe(self, progress: Progress, now: float) -> str:
        parts = []
        covered = real_time_factor(self._log.stamps[: progress.scans], now - self._started)
        if covered is not None:
            parts.append(f"{covered:.0f}x real time")
        if progress.tried and progress.stage == "matching":
            parts.append(f"{100 * progress.accepted / progress.tried:.0f} % matched")
        return ", ".join(parts)


@contextmanager
def reading_bar(path: Path) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr while a log is read that takes long: messages read of those there are.

    Args:
        path: the log.

    Yields:
        What to call with how many messages are read, and how many there are.
    """
    interval = _INTERVAL_ON_TERMINAL_S if sys.stderr.isatty() else _INTERVAL_IN_FILE_S
    with _Bar(
        desc=f"{path.name}, reading", bar_format=_READING, delay=_SHORT_READ_S, mininterval=interval, file=sys.stderr
    ) as bar:

        def report(read: int, known: int) -> None:
            bar.total = max(read, known)
            bar.update(read - bar.n)

        yield report


def real_time_factor(stamps: NDArray[np.float64], seconds: float) -> float | None:
    """Recorded time over processing time.

    Args:
        stamps: (n,) of the log [s].
        seconds: of processing.

    Returns:
        Their ratio; None when the log has no time.
    """
    if len(stamps) < 2 or seconds <= 0:
        return None
    recorded = float(stamps[-1] - stamps[0])
    return recorded / seconds if recorded > 0 else None


@contextmanager
def compile_note() -> Iterator[None]:
    """Say once on stderr when kernels are being compiled: the first run takes longer, later ones load them."""
    from numba.core import event

    class Note(event.Listener):
        told = False

        def on_start(self, _event: object) -> None:
            if not self.told:
                self.told = True
                tqdm.write("First run: compiling kernels, up to a minute; later runs load them.", file=sys.stderr)

        def on_end(self, _event: object) -> None:
            pass

    with event.install_listener("numba:compile", Note()):
        yield
