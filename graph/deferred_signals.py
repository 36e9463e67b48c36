"""A few steps that no Ctrl-C comes between."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that ask a process to end, those of them that the system has."""


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Hold back the signals that ask the process to end until the end of the block; then the first of them counts."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are handled by the main thread
        return
    received: list[int] = []

    def remember(number: int, _frame: FrameType | None) -> None:
        received.append(number)

    previous = {}
    try:
        for number in ENDING_SIGNALS:
            handler = signal.getsignal(number)
            if handler not in (signal.SIG_IGN, None):
                previous[number] = handler
                signal.signal(number, remember)
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    if received:
        signal.raise_signal(received[0])
