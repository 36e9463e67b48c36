"""A damaged database of ROS 2 read row by row, from its beginning and then from its end."""

import os
import shutil
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from frontends.bags.message import Channel, Message, See, Tell, type_name

_MOST_MISSING = 1 << 40
_ROWS = "SELECT id, topic_id, timestamp, data FROM messages"


def recover(path: Path, types: Collection[str], see: See, tell: Tell) -> Iterator[Message]:
    """Yield the messages of some types in the order of their rows, as far as they can be read from either end.

    Args:
        path: the file.
        types: names of message types as ROS 2 writes them.
        see: told of each channel, once for each of its messages.
        tell: told what was left out.
    """
    try:
        with (
            _of_stated_size(path) as whole,
            closing(sqlite3.connect(f"{whole.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database,
        ):
            channels = _channels(database)
            newest = -1
            for row in _rows(database, f"{_ROWS} ORDER BY id", tell, path):
                newest = row[0] if isinstance(row[0], int) else newest
                yield from _message(row, channels, types, see)
            behind = [
                message
                for row in _rows(database, f"{_ROWS} WHERE id > {newest} ORDER BY id DESC", lambda _: None, path)
                for message in _message(row, channels, types, see)
            ]
            yield from reversed(behind)
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:  # the last of a message of SQLite's
        tell(f"{path.name}: the database is damaged ({error})")


@contextmanager
def _of_stated_size(path: Path) -> Iterator[Path]:
    """The file; of one that was cut off a copy as long as it says it is, for SQLite reads none that is shorter."""
    with path.open("rb") as file:
        head = file.read(32)
    page_bytes, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    missing = (65536 if page_bytes == 1 else page_bytes) * pages - path.stat().st_size
    if not 0 < missing <= _MOST_MISSING:
        yield path
        return
    with TemporaryDirectory(prefix="iceg-") as room:
        whole = Path(room) / "whole.db3"
        shutil.copyfile(path, whole)
        os.truncate(whole, path.stat().st_size + missing)
        yield whole


def _channels(database: sqlite3.Connection) -> dict[int, Channel]:
    rows = database.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
    return {
        number: Channel(str(name), type_name(str(kind)), is_cdr=encoding == "cdr")
        for number, name, kind, encoding in rows
    }


def _rows(database: sqlite3.Connection, query: str, tell: Tell, path: Path) -> Iterator[tuple[object, ...]]:
    """Rows up to the first that cannot be read."""
    try:
        yield from database.execute(query)
    except (sqlite3.Error, UnicodeDecodeError) as error:
        tell(f"{path.name}: the database is damaged ({error}): rows are left out")


def _message(
    row: tuple[object, ...],
    channels: dict[int, Channel],
    types: Collection[str],
    see: See,
) -> Iterator[Message]:
    _, topic, logged, data = row
    channel = channels.get(topic) if isinstance(topic, int) else None
    if channel is None or not isinstance(logged, int) or not isinstance(data, bytes):
        return
    see(channel, 1)
    if channel.type in types and channel.is_cdr:
        yield Message(channel, 1e-9 * logged, data)
