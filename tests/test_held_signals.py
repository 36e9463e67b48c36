"""Signals held back: none raises where it could leave a lock behind, none is lost."""

import signal
import sys
import threading
from collections.abc import Iterator

import pytest

from iceg.evaluation.bench.held_signals import held_back

_NUMBERS = [signal.SIGINT] if sys.platform == "win32" else [signal.SIGINT, signal.SIGTERM]


@pytest.fixture(autouse=True)
def sigterm_interrupts() -> Iterator[None]:
    """As in the command: SIGTERM raises, too."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("number", _NUMBERS)
def test_a_signal_raises_where_it_is_delivered(number: int) -> None:
    with held_back() as deliver:
        deliver()
        signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            deliver()
        deliver()


def test_a_signal_that_nobody_took_raises_at_the_end() -> None:
    with pytest.raises(KeyboardInterrupt), held_back():
        signal.raise_signal(signal.SIGINT)


def test_afterwards_signals_raise_at_once() -> None:
    with held_back():
        pass
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_what_the_parent_ignores_stays_ignored() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    with held_back() as deliver:
        signal.raise_signal(signal.SIGTERM)
        deliver()
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_IGN


def test_another_thread_leaves_the_handlers_alone() -> None:
    seen: list[object] = []

    def look() -> None:
        with held_back():
            seen.append(signal.getsignal(signal.SIGINT))

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert seen == [before]
