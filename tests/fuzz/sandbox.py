"""Running one command line in a process of its own, with bounds on memory and time, and what became of it."""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

MOST_BYTES = 2_000_000_000
MOST_SECONDS = 60.0
_ADDRESS_SPACE = 12_000_000_000  # libraries and compiled code reserve far more than they touch


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a command.

    Attributes:
        code: its exit code; negative for a signal.
        told: the end of what it printed as an error.
        peak_bytes: the most memory it touched.
        seconds: wall time.
    """

    code: int
    told: str
    peak_bytes: int
    seconds: float

    @property
    def finding(self) -> str:
        """What is wrong with it: nothing, a traceback, a signal, too much memory or too much time."""
        if self.seconds > MOST_SECONDS:
            return "time"
        if self.code < 0:
            return "signal"
        if self.peak_bytes > MOST_BYTES or "MemoryError" in self.told:
            return "memory"
        return "traceback" if "Traceback (most recent call last)" in self.told or self.code not in {0, 1, 2} else ""


def run_command(words: Sequence[str], folder: Path, seconds: float = MOST_SECONDS) -> Outcome:
    """Run `iceg` with these words in a folder, and stop it when it takes longer than allowed."""
    started = time.perf_counter()
    with (folder / ".told").open("w+b") as told:
        process = subprocess.Popen(
            [sys.executable, "-m", "iceg", *words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=told,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONSAFEPATH": "1"},
        )
        resource.prlimit(process.pid, resource.RLIMIT_AS, (_ADDRESS_SPACE, _ADDRESS_SPACE))
        timer = threading.Timer(seconds + 1.0, os.kill, (process.pid, signal.SIGKILL))
        timer.start()
        _, status, usage = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        told.seek(0)
        text = told.read()[-4000:].decode("utf-8", "replace")
    return Outcome(
        code=process.returncode, told=text, peak_bytes=usage.ru_maxrss * 1024, seconds=time.perf_counter() - started
    )
