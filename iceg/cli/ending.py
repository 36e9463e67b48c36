"""How the program ends when a signal tells it to: Ctrl-C, SIGTERM and SIGHUP alike, with one line and its exit code.

Loads next to nothing, as the handlers have to be there before all else is loaded.
"""

from __future__ import annotations

import os
import signal
import sys

from iceg.ending_signals import ENDING_SIGNALS

TYPE_CHECKING = False  # typing takes longer to load than all of this
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import FrameType

_received: list[int] = []
"""Signals that have told this process to end: an interrupt may come out of compiled libraries as another error."""


def install() -> None:
    """From now on signals end the process, which has nothing to clear up yet; those ignored by its parent stay so."""
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _end)


def interrupt_instead() -> None:
    """From now on signals raise KeyboardInterrupt, so that what is written and who was started can be cleared up."""
    _replace(_end, _interrupt)


def end_at_once() -> None:
    """From now on signals end the process again: all is cleared up, or need not be."""
    _replace(_interrupt, _end)


def is_told_to_end() -> bool:
    """Whether a signal has told this process to end."""
    return bool(_received)


def say_interrupted(more: Sequence[object] = ()) -> int:
    """Print the one line.

    Args:
        more: what else there is to say, such as what was kept.

    Returns:
        The exit code: 128 and the number of the signal.
    """
    end_at_once()
    try:
        print(_line(more), file=sys.stderr, flush=True)
    except OSError:  # the terminal is gone; nor is anything to be flushed into it at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    return _exit_code()


def _replace(present: Callable[[int, FrameType | None], None], wanted: Callable[[int, FrameType | None], None]) -> None:
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) is present:
            signal.signal(number, wanted)


def _end(number: int, _frame: FrameType | None) -> None:
    _received.append(number)
    try:
        os.write(2, f"{_line()}\n".encode())  # `print` may have been interrupted itself
    finally:
        os._exit(_exit_code())


def _interrupt(number: int, _frame: FrameType | None) -> None:
    _received.append(number)
    raise KeyboardInterrupt


def _line(more: Sequence[object] = ()) -> str:
    return "\niceg: " + ", ".join(["interrupted", *map(str, more)])


def _exit_code() -> int:
    return 128 + (_received[0] if _received else signal.SIGINT)
