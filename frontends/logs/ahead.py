"""Items worked out in a thread ahead of whoever uses them: unpacking leaves the interpreter to others meanwhile."""

from collections.abc import Generator, Iterator
from contextlib import suppress
from queue import Empty, Queue
from threading import Event, Thread
from typing import TypeVar

_Item = TypeVar("_Item")
_DEPTH = 2
"""Items that may wait."""


def ahead(items: Iterator[_Item]) -> Generator[_Item, None, None]:
    """The same items in the same order; what they raise is raised in its turn.

    Args:
        items: made by another thread, which has ended when this generator has, or is closed.
    """
    waiting: Queue[tuple[_Item] | BaseException | None] = Queue(_DEPTH)
    is_over = Event()
    worker = Thread(target=_work, args=(items, waiting, is_over), daemon=True)
    worker.start()
    try:
        while (entry := waiting.get()) is not None:
            if isinstance(entry, BaseException):
                raise entry
            yield entry[0]
    finally:
        is_over.set()
        with suppress(Empty):
            waiting.get_nowait()  # it may wait for room
        worker.join()


def _work(items: Iterator[_Item], waiting: "Queue[tuple[_Item] | BaseException | None]", is_over: Event) -> None:
    """Put the items into a queue, each in a tuple, and at last what ended them: None or an error."""
    try:
        for item in items:
            waiting.put((item,))
            if is_over.is_set():
                return
        end = None
    except BaseException as err:  # noqa: BLE001 raised again where the items are used
        end = err
    waiting.put(end)
