"""Files are replaced all at once or not at all, whatever ends the process, at whichever of its calls."""

import itertools
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path

import pytest

from graph.atomic import write_atomically
from graph.publish import WORKSHOP, check_replaceable, publishing, settle
from tests.process_faults import Fault, ends_at, write_by_parts

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="a process that can be killed at each call is a fork")

NAMES = ("a", "b", "c")
OLD = {"a": b"old a", "c": b"old c"}
NEW = {"a": b"new a", "b": b"new b"}
THIRD = {"b": b"third b", "c": b"third c"}
NOTHING: dict[str, bytes] = {}


@pytest.fixture(autouse=True)
def no_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Killing a process spares the disk; calls of fsync are numbered all the same."""
    monkeypatch.setattr(os, "fsync", lambda _handle: None)


def publish(directory: Path, files: Mapping[str, bytes]) -> None:
    with publishing(directory, replaces=NAMES) as staging:
        for name, content in files.items():
            write_by_parts(staging / name, content)


def read(directory: Path) -> dict[str, bytes]:
    """What any program finds under the names."""
    return {name: (directory / name).read_bytes() for name in NAMES if (directory / name).exists()}


def left(directory: Path) -> set[str]:
    """Names in a folder."""
    return {path.name for path in directory.iterdir()} if directory.exists() else set()


def plain(directory: Path) -> bool:
    """Whether nothing of a publication is left in a folder."""
    return not (directory / WORKSHOP).exists() and not any(path.is_symlink() for path in directory.iterdir())


def with_notes(directory: Path, files: Mapping[str, bytes]) -> Path:
    """A folder with results and what a user has put there."""
    (directory / "pictures").mkdir(parents=True)
    (directory / "pictures" / "a").write_text("mine")
    (directory / "notes.txt").write_text("mine")
    for name, content in files.items():
        (directory / name).write_bytes(content)
    return directory


@pytest.mark.parametrize("fault", ["kill", "error", "signal"])
@pytest.mark.parametrize("old", [OLD, NOTHING])
def test_whatever_ends_it_all_is_old_or_all_is_new(tmp_path: Path, fault: Fault, old: dict[str, bytes]) -> None:
    seen = []
    for number in itertools.count():
        directory = with_notes(tmp_path / str(number), old)
        if not ends_at(number, fault, lambda: publish(directory, NEW)):  # noqa: B023 called at once
            break
        found = read(directory)
        assert found in (old, NEW), number
        seen.append(found == NEW)
        if fault == "signal":
            assert plain(directory), number
        publish(directory, THIRD)
        assert read(directory) == THIRD
        assert plain(directory)
        assert left(directory) == {"b", "c", "notes.txt", "pictures"}
        assert (directory / "pictures" / "a").read_text() == (directory / "notes.txt").read_text() == "mine"
    assert len(seen) > 30
    assert 0 < sum(seen) < len(seen)
    assert fault == "error" or seen == sorted(seen)  # an error that is of no consequence ends nothing


def test_whatever_kills_a_recovery_too_it_is_the_same_result_still(tmp_path: Path) -> None:
    for first in itertools.count(step=3):
        directory = with_notes(tmp_path / str(first), OLD)
        if not ends_at(first, "kill", lambda: publish(directory, NEW)):  # noqa: B023
            break
        found = read(directory)
        for again in range(first % 5, 40, 5):
            went_on = ends_at(again, "kill", lambda: settle(directory))  # noqa: B023
            assert read(directory) == found, (first, again)
            if not went_on:
                break
        settle(directory)
        assert read(directory) == found
        assert plain(directory)


@pytest.mark.parametrize("fault", ["kill", "error", "signal"])
def test_a_folder_made_in_vain_is_none(tmp_path: Path, fault: Fault) -> None:
    for number in itertools.count():
        directory = tmp_path / str(number)
        if not ends_at(number, fault, lambda: publish(directory, NEW)):  # noqa: B023
            break
        complete = directory.exists() and read(directory) == NEW
        if directory.exists():
            settle(directory)
            assert left(directory) == (set(NEW) if complete else set())
        assert fault != "signal" or complete or not directory.exists(), number
    assert read(directory) == NEW


def test_without_hard_links_old_files_are_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "link", refuse)
    for number in itertools.count():
        directory = with_notes(tmp_path / str(number), OLD)
        if not ends_at(number, "kill", lambda: publish(directory, NEW)):  # noqa: B023
            break
        assert read(directory) in (OLD, NEW)
        publish(directory, THIRD)
        assert read(directory) == THIRD
    assert plain(directory)


def test_without_symbolic_links_files_are_replaced_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "symlink", refuse)
    directory = with_notes(tmp_path / "out", OLD)
    publish(directory, NEW)
    assert read(directory) == NEW
    assert plain(directory)


def test_links_of_the_user_are_replaced_and_what_they_lead_to_is_not(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").write_bytes(b"mine")
    directory = tmp_path / "out"
    directory.mkdir()
    (directory / "a").symlink_to("../elsewhere")
    (directory / "b").symlink_to("nowhere")
    publish(directory, NEW)
    assert read(directory) == NEW
    assert plain(directory)
    assert (tmp_path / "elsewhere").read_bytes() == b"mine"


def test_the_folder_may_be_a_link_or_the_current_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    directory = with_notes(tmp_path / "real", OLD)
    (tmp_path / "link").symlink_to("real")
    publish(tmp_path / "link", NEW)
    assert read(directory) == NEW
    monkeypatch.chdir(directory)
    publish(Path(), THIRD)
    assert read(directory) == THIRD
    assert os.path.samestat(Path.cwd().stat(), directory.stat())


def test_what_is_no_file_is_not_replaced(tmp_path: Path) -> None:
    directory = with_notes(tmp_path / "out", OLD)
    (directory / "b").mkdir()
    with pytest.raises(FileExistsError) as refused:
        check_replaceable(directory, NAMES)
    with pytest.raises(FileExistsError) as too_late:
        publish(directory, NEW)
    assert refused.value.filename == too_late.value.filename == str(directory / "b")
    (directory / "b").rmdir()
    assert read(directory) == OLD
    assert plain(directory)


def test_a_folder_of_that_name_that_is_not_ours_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / WORKSHOP).mkdir()
    (tmp_path / WORKSHOP / "thesis.tex").write_text("mine")
    with pytest.raises(FileExistsError):
        publish(tmp_path, NEW)
    assert (tmp_path / WORKSHOP / "thesis.tex").read_text() == "mine"


def test_of_several_at_a_time_each_is_whole(tmp_path: Path) -> None:
    directory = tmp_path / "out"

    def publish_often(who: int) -> None:
        for _ in range(20):
            publish(directory, dict.fromkeys(NAMES[who % 2 :], b"%d" % who))

    children = []
    for who in range(3):
        child = os.fork()
        if child == 0:
            try:
                publish_often(who)
            except BaseException:  # noqa: BLE001
                os._exit(1)
            os._exit(0)
        children.append(child)
    codes = [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children]
    assert codes == [0, 0, 0]
    assert len(set(read(directory).values())) == 1
    assert plain(directory)


def test_a_process_that_is_really_killed_leaves_a_whole_result(tmp_path: Path) -> None:
    program = (
        "import itertools, sys\n"
        "from pathlib import Path\n"
        "from graph.publish import publishing\n"
        "for number in itertools.count():\n"
        "    with publishing(Path(sys.argv[1])) as staging:\n"
        "        for name in 'abc':\n"
        "            (staging / name).write_bytes(b'%d' % number * 1000)\n"
        "    print(number, flush=True)\n"
    )
    for n_ms in range(0, 30, 5):
        with subprocess.Popen(
            [sys.executable, "-c", program, str(tmp_path / "out")], stdout=subprocess.PIPE
        ) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(1e-3 * n_ms)
            process.kill()
        found = read(tmp_path / "out")
        assert len(found) == 3
        assert len(set(found.values())) == 1
    publish(tmp_path / "out", THIRD)
    assert read(tmp_path / "out") == THIRD
    assert plain(tmp_path / "out")


def test_one_file_is_whole_too_and_the_next_writer_clears_what_is_left(tmp_path: Path) -> None:
    for number in itertools.count():
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "graph.g2o").write_bytes(b"old")
        if not ends_at(number, "kill", lambda: write_atomically(folder / "graph.g2o", b"new")):  # noqa: B023
            break
        assert (folder / "graph.g2o").read_bytes() in (b"old", b"new")
        write_atomically(folder / "graph.g2o", b"third")
        assert left(folder) == {"graph.g2o"}
        assert (folder / "graph.g2o").read_bytes() == b"third"
    assert number > 3


def test_threads_write_one_file_in_turn(tmp_path: Path) -> None:
    path = tmp_path / "file"
    contents = [b"%d" % k * 10_000 for k in range(8)]
    threads = [threading.Thread(target=write_atomically, args=(path, content)) for content in contents]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert path.read_bytes() in contents
    assert left(tmp_path) == {"file"}
