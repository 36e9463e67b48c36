"""What the stages of a run take."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class StageClock:
    """Seconds spent in each stage, whenever it goes on: on the wall, and of the processor by the stage's own thread."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the block in."""
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
