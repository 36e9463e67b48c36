"""What runs in a thread or a second process gives what it gives in turn."""

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from graph.errors import IcegError
from iceg import beside
from iceg.beside import InThread, in_second_process


@pytest.fixture(params=[True, False], ids=["two processors", "one"])
def two_processors(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    can = bool(request.param)
    monkeypatch.setattr(beside, "has_second_processor", lambda: can)
    monkeypatch.setattr(beside, "may_fork", lambda: can and hasattr(os, "fork"))
    return can


def failing() -> int:
    raise IcegError("robot.clf: found nothing")


@pytest.mark.usefixtures("two_processors")
def test_a_thread_hands_over_its_result() -> None:
    assert InThread(lambda: 3 + 4).result() == 7


@pytest.mark.usefixtures("two_processors")
def test_an_error_of_a_thread_is_raised_where_its_result_is_asked_for() -> None:
    work = InThread(failing)
    with pytest.raises(IcegError, match=r"robot\.clf: found nothing"):
        work.result()


def test_a_second_process_hands_over_its_result_and_its_files(tmp_path: Path, two_processors: bool) -> None:
    def write() -> int:
        (tmp_path / "pid").write_text(str(os.getpid()))
        return 7

    with in_second_process(write) as written:
        assert written() == 7
    is_own = int((tmp_path / "pid").read_text()) == os.getpid()
    assert is_own != (two_processors and hasattr(os, "fork"))


@pytest.mark.usefixtures("two_processors")
def test_an_error_of_a_second_process_is_raised_where_its_result_is_asked_for() -> None:
    with in_second_process(failing) as failed, pytest.raises(IcegError, match=r"robot\.clf: found nothing"):
        failed()


@pytest.mark.usefixtures("two_processors")
def test_a_large_result_goes_through_the_pipe() -> None:
    with in_second_process(lambda: bytes(5_000_000)) as made:
        assert made() == bytes(5_000_000)


def test_a_second_process_that_dies_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    if not hasattr(os, "fork"):
        pytest.skip("this system cannot copy a process")
    monkeypatch.setattr(beside, "may_fork", lambda: True)

    def die() -> None:
        os._exit(3)

    with in_second_process(die) as died, pytest.raises(ChildProcessError, match="before its work was done"):
        died()


def test_a_second_process_ends_with_the_block_that_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    if not hasattr(os, "fork"):
        pytest.skip("this system cannot copy a process")
    monkeypatch.setattr(beside, "may_fork", lambda: True)
    with pytest.raises(IcegError), in_second_process(lambda: time.sleep(600)):
        failing()
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)  # none is left


def test_a_process_with_other_threads_is_not_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "has_second_processor", lambda: True)
    done = threading.Event()
    waiting = threading.Thread(target=done.wait)
    waiting.start()
    try:
        assert not beside.may_fork()
    finally:
        done.set()
        waiting.join()


def test_one_processor_takes_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "has_second_processor", lambda: False)
    order: list[str] = []

    def note(what: str) -> Callable[[], None]:
        return lambda: order.append(what)

    later = InThread(note("later"))
    note("first")()
    later.result()
    assert order == ["first", "later"]
