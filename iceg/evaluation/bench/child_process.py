"""Python processes of our own: nothing is imported from the current folder, and none outlives whoever waits for it."""

import os
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence

_PATIENCE_S = 5.0
"""A process told to end has so long to clear up."""


class Children:
    """Child processes, one or several at a time, that are ended together."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._is_ended = False

    def run(
        self,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        *,
        given: str = "",
        time_limit_s: float | None = None,
    ) -> subprocess.CompletedProcess[str]:
        """Run a module of iceg as a program, to its end.

        Args:
            module: its name.
            arguments: of the program.
            environment: variables it gets besides those of this process.
            given: what it reads on its standard input.
            time_limit_s: it is ended after that [s].

        Returns:
            Its exit code, the negative number of a signal, and what it has printed.

        Raises:
            subprocess.TimeoutExpired: it was ended after the time limit.
        """
        # -P, as `python -m` looks for modules in the current folder first, and PYTHONSAFEPATH for processes it starts.
        command = [sys.executable, "-P", "-m", module, *arguments]
        process = self._start(command, os.environ | {**environment, "PYTHONSAFEPATH": "1"})
        try:
            printed, complaints = process.communicate(given, timeout=time_limit_s)
        except BaseException:
            _end(process)
            raise
        finally:
            with self._lock:
                self._running.discard(process)
        return subprocess.CompletedProcess(command, process.returncode, printed, complaints)

    def end(self) -> None:
        """End all that run, and start no more."""
        with self._lock:
            self._is_ended = True
            running = list(self._running)
        for process in running:
            process.terminate()
        for process in running:
            _end(process)

    def _start(self, command: Sequence[str], environment: Mapping[str, str]) -> subprocess.Popen[str]:
        with self._lock:
            if self._is_ended:
                raise KeyboardInterrupt
            process = subprocess.Popen(
                command,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
            )
            self._running.add(process)
        return process


def _end(process: "subprocess.Popen[str]") -> None:
    """Let a process clear up and end; else end it."""
    process.terminate()
    try:
        process.wait(_PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
