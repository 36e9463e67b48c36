"""What the stages of a run take."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class StageClock:
    """Seconds spent in each stage, whenever it goes on: on the wall, and of the processor by the stage's own thread.

    Args:
        begun: called with the name of each stage that begins.
    """

    def __init__(self, begun: Callable[[str], None] | None = None) -> None:
        self._begun = begun
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}

    def begin(self, name: str) -> None:
        """Tell that a stage begins, one that another clock counts, perhaps."""
        if self._begun is not None:
            self._begun(name)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the block in."""
        self.begin(name)
        started, cpu_started = time.perf_counter(), time.thread_time()
        yield
        taken, cpu_taken = time.perf_counter() - started, time.thread_time() - cpu_started
        self.seconds[name] = round(self.seconds.get(name, 0.0) + taken, 4)
        self.cpu_seconds[name] = round(self.cpu_seconds.get(name, 0.0) + cpu_taken, 4)

    def add(self, other: "StageClock") -> None:
        """Count in what another clock has noted."""
        for mine, others in ((self.seconds, other.seconds), (self.cpu_seconds, other.cpu_seconds)):
            for name, seconds in others.items():
                mine[name] = round(mine.get(name, 0.0) + seconds, 4)
