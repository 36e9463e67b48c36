"""What a run says while it runs: how far it is, as a bar in a terminal or a notebook, as few lines elsewhere."""

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import RLock
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from tqdm import TqdmWarning, tqdm

from frontends.scan import Log
from iceg.slam.progress import Progress, Stage

_BAR = "{desc}: {percentage:3.0f}%|{bar:20}| {elapsed} gone{postfix}"
_READING = "{desc}: {percentage:3.0f}%|{bar:20}| {n_fmt}/{total_fmt} messages, {elapsed} gone"
_COMPILING = "{desc}: {percentage:3.0f}%|{bar:20}| {n_fmt} of {total_fmt}, {elapsed} gone"
_SHORT_READ_S = 1.0
_INTERVAL_ON_TERMINAL_S, _INTERVAL_IN_FILE_S = 0.1, 30.0
_SHOWN_EVERY_S = 0.05
"""A stage tells thousands of times a second where it stands."""
_SHARES: dict[Stage, float] = {
    "matching": 35.0,
    "sweep": 3.0,
    "graph": 18.0,
    "finish": 25.0,
    "covariances": 1.0,
    "feature_map": 3.0,
    "grid": 5.0,
}
"""About how much of a run each stage takes [%], on typical logs; the rest is writing."""
_WRITING = 100.0 - sum(_SHARES.values())
_WORDS: dict[Stage, str] = {"feature_map": "feature map", "sweep": "sweep of the laser"}

tqdm.set_lock(RLock())  # its own is for bars of several processes, and loads all of multiprocessing


class _Bar(tqdm):  # type: ignore[type-arg]
    """A bar without the thread that watches over bars: a process that has threads must not be copied."""

    monitor_interval = 0


class _Lines(_Bar):
    """A line wherever a bar would be drawn anew, for files, which nobody can draw over."""

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        """Write a line; nothing is there to be cleared later."""
        del pos
        text = str(self) if msg is None else msg
        if text:
            self.fp.write(f"{text}\n")
            self.fp.flush()

    def clear(self, *_: object, **__: object) -> None:
        """Lines stay."""


class ProgressBar:
    """A bar on stderr for a whole run: stage, scans, real-time factor, share of accepted matches. A context manager.

    It is full only when the block has ended well. Where stderr is no terminal, a line tells of each new stage.

    Attributes:
        matching: where the matching of scans came to.
    """

    def __init__(self, log: Log) -> None:
        self.matching = Progress(scans=0, tried=0, accepted=0)
        self._log = log
        self._started = time.perf_counter()
        self._shown: tuple[Stage | None, float] = (None, self._started)
        self._told = "starting"
        self._bar = _bar(desc=f"{log.path.name}, starting", total=100.0, bar_format=_BAR)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self._show("done", 100.0, self._counts(self.matching, len(self._log)))
        self._bar.close()

    def __call__(self, progress: Progress) -> None:
        """Show where the run stands; cheap when nothing is due."""
        if progress.stage == "filtering":
            self._show("filtering", (100.0 - _WRITING) * self._done(progress), self._counts(progress, progress.scans))
            return
        if progress.stage == "matching":
            self.matching = progress
        now = time.perf_counter()
        is_early = progress.stage == self._shown[0] and now < self._shown[1] + _SHOWN_EVERY_S
        if is_early and progress.scans < len(self._log):
            return
        self._shown = (progress.stage, now)
        before = sum(share for stage, share in _SHARES.items() if _place(stage) < _place(progress.stage))
        within = _SHARES["matching"] * self._done(progress) if progress.stage == "matching" else 0.0
        words = _WORDS.get(progress.stage, progress.stage)
        postfix = self._counts(progress, progress.scans) if progress.stage == "matching" else ""
        self._show(words, before + within, postfix)

    def writing(self, name: str, begun: int, of: int) -> None:
        """Show that a file is being written, the one after `begun` of `of`."""
        self._show(f"writing {name}", 100.0 - _WRITING * (1.0 - begun / of), "")

    def compiling(self, compiled: int, of: int) -> None:
        """Show that the run waits for kernels, of which some are compiled."""
        self._show(f"compiling {compiled} of {of}", self._bar.n, "")

    def _show(self, stage: str, share: float, postfix: str) -> None:
        description = f"{self._log.path.name}, {stage}"
        is_new = _first_word(stage) != _first_word(self._told) if _is_in_file() else stage != self._told
        self._told = stage
        self._bar.set_description_str(description, refresh=False)
        self._bar.set_postfix_str(postfix, refresh=False)
        self._bar.update(max(share - self._bar.n, 0.0))
        if is_new:
            self._bar.refresh()

    def _done(self, progress: Progress) -> float:
        return min(progress.scans / len(self._log), 1.0)

    def _counts(self, progress: Progress, scans: int) -> str:
        covered = real_time_factor(self._log.stamps[:scans], time.perf_counter() - self._started)
        speed = "" if covered is None else f"{covered:.0f}x real time"
        matched = f"{100 * progress.accepted / progress.tried:.0f} % matched" if progress.tried else ""
        return ", ".join(filter(None, (f"{scans}/{len(self._log)} scans", speed, matched)))


def _first_word(stage: str) -> str:
    """What the steps of one stage share: `writing map` and `writing report` are the same in a file."""
    return stage.partition(" ")[0]


def _place(stage: Stage) -> int:
    return list(_SHARES).index(stage)


def _bar(**described: Any) -> Any:  # noqa: ANN401
    """A bar on stderr, one of the notebook's own, or lines in a file."""
    kind: Any = _Bar
    if _is_in_notebook():
        with warnings.catch_warnings():  # without ipywidgets it says so, and draws its bar with letters
            warnings.simplefilter("ignore", TqdmWarning)
            from tqdm import auto
        kind = auto.tqdm
        described["bar_format"] = described["bar_format"].replace("{bar:20}", "{bar}")
    if _is_in_file():
        words = described.pop("bar_format").replace("|{bar:20}|", ",")
        return _Lines(mininterval=_INTERVAL_IN_FILE_S, file=sys.stderr, leave=False, bar_format=words, **described)
    return kind(mininterval=_INTERVAL_ON_TERMINAL_S, file=sys.stderr, **described)


def _is_in_notebook() -> bool:
    """Whether a notebook's kernel runs this; who only starts kernels elsewhere has ipykernel imported, too."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return shell is not None and "IPKernelApp" in shell.config


def _is_in_file() -> bool:
    """Whether what is written to stderr stays as it is, line by line."""
    return not _is_in_notebook() and not sys.stderr.isatty()


@contextmanager
def compiling_bar() -> Iterator[Callable[[int, int], None]]:
    """A bar while kernels are compiled ahead.

    Yields:
        What to call with how many are compiled, and how many are waited for.
    """
    description = "first run, compiling"
    with _bar(desc=description, bar_format=_COMPILING, delay=_SHORT_READ_S) as bar:

        def report(compiled: int, known: int) -> None:
            bar.total = known
            bar.update(compiled - bar.n)

        yield report


def prepare_kernels() -> None:
    """Compile what is not compiled yet, with a bar; at once where that was done before."""
    from iceg.kernels.ahead import compile_ahead

    with compiling_bar() as told:
        compile_ahead(told)


@contextmanager
def reading_bar(path: Path) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr while a log is read that takes long: messages read of those there are.

    Args:
        path: the log.

    Yields:
        What to call with how many messages are read, and how many there are.
    """
    with _bar(desc=f"{path.name}, reading", bar_format=_READING, delay=_SHORT_READ_S) as bar:

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
    """Say once on stderr when the block compiles kernels: those that few logs need are not compiled ahead."""
    from numba.core import event

    class Note(event.Listener):
        told = False

        def on_start(self, _event: object) -> None:
            if not self.told:
                self.told = True
                tqdm.write("compiling kernels that only this needs; later runs load them", file=sys.stderr)

        def on_end(self, _event: object) -> None:
            pass

    with event.install_listener("numba:compile", Note()):
        yield
