"""The files of a bag, of whatever container, as one stream of serialised messages."""

import lzma
import re
import shutil
import sqlite3
import zlib
from collections.abc import Collection, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, NamedTuple, cast

from frontends.bags import mcap_recovery, ros1_recovery, rosbags_files, sqlite_recovery
from frontends.bags.errors import BagError
from frontends.bags.magic import ZSTD, container
from frontends.bags.message import Channel, Message, See, Tell
from frontends.logs.text import OPENERS
from graph.errors import reason
from graph.files import check_file
from graph.limits import LimitError, check_limit

_SUFFIXES = (".bag", ".db3", ".mcap", ".zstd")
_RECOVERIES = {
    "ros1": ros1_recovery.recover,
    "sqlite3": sqlite_recovery.recover,
    "mcap": mcap_recovery.recover,
}
"""Read what is there without an index, and say where it ends."""


class BagFile(NamedTuple):
    """One file of a bag.

    Attributes:
        path: where it is.
        container: "ros1", "sqlite3" or "mcap".
    """

    path: Path
    container: str


class DamagedFileError(BagError):
    """A file that cannot be read to its end as its index says."""

    def __init__(self, file: BagFile, found: str) -> None:
        super().__init__(f"{file.path}: {found}")
        self.file = file
        self.found = found


@dataclass(kw_only=True)
class Bag:
    """The files of one recording, in order.

    Attributes:
        path: the file or folder it was opened as.
        files: what it consists of.
        warnings: what a person should know about them.
        damaged: those read without their index, and why.
    """

    path: Path
    files: list[BagFile]
    warnings: list[str] = field(default_factory=list)
    damaged: dict[BagFile, str] = field(default_factory=dict)

    def messages(self, types: Collection[str], see: See, tell: Tell) -> Iterator[Message]:
        """Every message of some types, file by file.

        Args:
            types: their names as ROS 2 writes them.
            see: told of every channel of each file, whatever its type, before its messages.
            tell: told what was left out, a sentence each.

        Raises:
            DamagedFileError: the index of a file is broken; enter it in `damaged` and start anew.
            BagError: a file cannot be read at all.
        """
        for file in self.files:
            if file in self.damaged:
                yield from _recovered(file, self.damaged[file], types, see, tell)
            elif is_foreign(file):
                yield from mcap_recovery.recover(file.path, types, see, tell)
            else:
                yield from _indexed(file, types, see)


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Find the files of a bag; those packed as a whole with zstd are unpacked for as long as it is open.

    Raises:
        BagError: there is no bag.
    """
    with ExitStack() as unpacked:
        try:
            paths, warnings = _in_folder(path) if path.is_dir() else ([path], [])
            files = [_opened(file, unpacked) for file in paths]
        except OSError as error:
            raise BagError(f"{path}: cannot be read ({reason(error)})") from error
        yield Bag(path=path, files=files, warnings=warnings)


def is_foreign(file: BagFile) -> bool:
    """Whether a file is MCAP but no recording of ROS 2, which has to be read record by record.

    Raises:
        BagError: it cannot be read at all.
    """
    try:
        return file.container == "mcap" and not mcap_recovery.is_of_ros2(file.path)
    except OSError as error:
        raise BagError(f"{file.path}: cannot be read ({reason(error)})") from error


def _indexed(file: BagFile, types: Collection[str], see: See) -> Iterator[Message]:
    try:
        yield from rosbags_files.read(file.path, file.container, types, see)
    except Exception as error:  # damage trips rosbags anywhere; a length gone wrong asks for any memory
        raise DamagedFileError(file, said_of_damage(error)) from error


def _recovered(file: BagFile, why: str, types: Collection[str], see: See, tell: Tell) -> Iterator[Message]:
    n = seen = 0

    def count(channel: Channel, of_it: int) -> None:
        nonlocal seen
        seen += of_it
        see(channel, of_it)

    try:
        for n, message in enumerate(_RECOVERIES[file.container](file.path, types, count, tell), 1):  # noqa: B007
            yield message
    except OSError as error:
        raise BagError(f"{file.path}: cannot be read ({reason(error)})") from error
    if not seen:
        raise BagError(f"{file.path}: damaged, and no message could be read ({why})")
    tell(f"{file.path.name}: its index cannot be used ({why}): the {n} messages that can be reached are read in turn")


def said_of_damage(error: Exception) -> str:
    """What rosbags says of damage, in one line; nothing of where it tripped over damage that it does not look for."""
    if isinstance(error, MemoryError):
        return "it states a size that does not fit into memory"
    said = " ".join(str(error).split())[:200]
    is_told = type(error).__module__.startswith("rosbags") and said
    return said if is_told else "it is not laid out as a bag is"  # what trips over damage says nothing to a person


def _container_of(path: Path) -> str | None:
    packed = _unpacking(path)
    try:
        with packed or path.open("rb") as file:
            return container(file.read(16))
    except _damage():
        return None


def _unpacking(path: Path) -> IO[bytes] | None:
    """What a file that was packed as a whole holds; None where it was not."""
    with path.open("rb") as file:
        head = file.read(6)
    if head.startswith(ZSTD):
        from frontends.bags.compression import zstd

        return cast("IO[bytes]", zstd.open(path, "rb"))
    opener = next((opener for magic, opener in OPENERS if head.startswith(magic)), None)
    return None if opener is None else cast("IO[bytes]", opener(path, "rb"))


def _damage() -> tuple[type[Exception], ...]:
    """What unpacking makes of damage."""
    from frontends.bags.compression import zstd

    return zstd.ZstdError, EOFError, zlib.error, lzma.LZMAError, OSError  # which bz2 and gzip raise


def _opened(path: Path, unpacked: ExitStack) -> BagFile:
    """A file with its container; one that is packed as a whole is unpacked until the stack is closed."""
    check_file(path, None, BagError, "a bag")  # read message by message: with cameras in it a bag may be of any size
    found = _container_of(path)
    if found is None:
        raise BagError(f"{path}: found no bag, expected one of ROS 1, or of ROS 2 as sqlite3 or MCAP")
    packed = _unpacking(path)
    if packed is not None:
        return BagFile(_unpacked(path, packed, Path(unpacked.enter_context(TemporaryDirectory(prefix="iceg-")))), found)
    log = path.with_name(f"{path.name}-wal")
    if found == "sqlite3" and log.is_file() and log.stat().st_size:
        return BagFile(_with_log(path, log, Path(unpacked.enter_context(TemporaryDirectory(prefix="iceg-")))), found)
    return BagFile(path, found)


def _unpacked(path: Path, packed: IO[bytes], room: Path) -> Path:
    unpacked, size = room / re.sub(r"\.(zstd?|gz|bz2|xz)$", "", path.name), 0
    with packed as source, unpacked.open("wb") as target:
        try:
            while block := source.read(1 << 20):
                size += len(block)
                check_limit(size, "log_bytes", f"{path}: found {size} bytes or more when unpacked")
                target.write(block)
        except LimitError as error:
            raise BagError(str(error)) from error
        except _damage():
            pass  # what is there is told when it is read
    return unpacked


def _in_folder(path: Path) -> tuple[list[Path], list[str]]:
    """The files of a folder that continue each other, in order, and what a person should know about them."""
    present = sorted((entry for entry in path.iterdir() if entry.suffix in _SUFFIXES), key=_natural)
    if not present:
        raise BagError(f"{path}: found no *.db3, *.mcap or *.bag in this folder, expected the files of a bag")
    named = _named(path / "metadata.yaml")
    missing = [name for name in named if not (path / name).exists()]
    warnings = []
    if missing:
        warnings.append(
            f"metadata.yaml names {', '.join(missing)}, which is not there: {_listed(present)} read instead"
        )
    if named and not missing:
        return [path / name for name in named], warnings
    if len({_stem(file) for file in present}) > 1:
        raise BagError(f"{path}: found several bags ({_listed(present)}), expected one, or the parts of one")
    return present, warnings


def _named(metadata: Path) -> list[str]:
    """The files that metadata.yaml names: none where it is missing or unreadable, and the folder tells."""
    if not metadata.exists():
        return []
    check_file(metadata, "settings_bytes", BagError, "the description of a bag")
    text = metadata.read_text(encoding="utf-8", errors="replace")
    block = re.search(r"relative_file_paths:[ ]*\n((?:[ ]*-[ ]+\S.*\n?)+)", text)
    names = re.findall(r"-[ ]+(\S.*)", block.group(1)) if block else []
    return [Path(name.strip().strip("'\"")).name for name in names]


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sorts part 10 behind part 9."""
    return [(int(word), "") if word.isdecimal() else (-1, word) for word in re.split(r"(\d+)", path.name)]


def _stem(path: Path) -> str:
    """The name of a recording without the number of its part, and without the date that ROS 1 gives each part."""
    name = re.sub(r"(_?\d{4}(-\d\d){5})?_\d+$", "", path.name.split(".", 1)[0])
    return name + path.name.removesuffix(".zstd")[-4:]


def _with_log(path: Path, log: Path, room: Path) -> Path:
    """A copy of a database of SQLite with what its write-ahead log holds, as a recorder that crashed leaves it.

    Raises:
        BagError: the copy cannot be made.
    """
    copy = room / path.name
    try:
        for file in (path, log):
            shutil.copyfile(file, room / file.name)
        with closing(sqlite3.connect(copy)) as database:
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            database.execute("PRAGMA journal_mode=DELETE").fetchall()
    except (OSError, sqlite3.Error) as error:
        raise BagError(f"{log}: what the recorder had still to write cannot be taken over ({error})") from error
    return copy


def _listed(paths: list[Path]) -> str:
    names = [path.name for path in paths]
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
