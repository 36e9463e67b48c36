"""What the stages of a run take."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class StageClock:
    """Seconds spent in each stage, whenever it goes on: on the wall, and of the processor.

    Args:
        begun: called with the name of each stage that begins.
    """

    def __init__(self, begun: Callable[[str], None] | None = None) -> None:
        self._begun = begun
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the block in."""
        if self._begun is not None:
            self._begun(name)
        started, cpu_started = time.perf_counter(), time.process_time()
        yield
        taken, cpu_taken = time.perf_counter() - started, time.process_time() - cpu_started
        self.seconds[name] = round(self.seconds.get(name, 0.0) + taken, 4)
        self.cpu_seconds[name] = round(self.cpu_seconds.get(name, 0.0) + cpu_taken, 4)
