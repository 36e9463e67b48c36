"""Signals held back until it is safe to raise.

A signal handler that raises may do so anywhere, also between taking a lock and noting that it must be given back: the
locks of futures, events and thread starts then stay taken, and whoever waits for them waits for ever.
"""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

from iceg.ending_signals import ENDING_SIGNALS


@contextlib.contextmanager
def held_back() -> Iterator[Callable[[], None]]:
    """Hold back the signals that end a program, as far as Python handles them; only the main thread can.

    Yields:
        What delivers those that have come. The end of the block does so, too.
    """
    came: list[tuple[int, FrameType | None]] = []
    handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
    if threading.current_thread() is threading.main_thread():
        present = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
        handlers = {number: handler for number, handler in present.items() if callable(handler)}

    def deliver() -> None:
        while came:
            number, frame = came.pop(0)
            handlers[number](number, frame)

    for number in handlers:
        signal.signal(number, lambda number, frame: came.append((number, frame)))
    try:
        yield deliver
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        deliver()
