"""Items worked out ahead of whoever uses them."""

import threading
from collections.abc import Iterator

import pytest

from frontends.logs.ahead import ahead


def test_all_items_come_in_their_order() -> None:
    assert list(ahead(iter(range(100)))) == list(range(100))


def test_what_ends_the_items_is_raised_in_its_turn() -> None:
    def failing() -> Iterator[int]:
        yield 1
        yield 2
        raise OSError("gone")

    items = ahead(failing())
    assert [next(items), next(items)] == [1, 2]
    with pytest.raises(OSError, match="gone"):
        next(items)


def test_no_thread_is_left_of_items_that_nobody_wants() -> None:
    before = threading.active_count()
    made: list[int] = []

    def counted() -> Iterator[int]:
        for item in range(1000):
            made.append(item)
            yield item

    items = ahead(counted())
    next(items)
    items.close()
    assert threading.active_count() == before
    assert len(made) < 10
