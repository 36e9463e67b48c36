"""An MCAP file record by record, without its summary: what was cut off or damaged, or is no recording of ROS 2.

Source: the MCAP specification (mcap.dev/spec). A record is one byte of operation, eight of length and its content.
"""

import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

from frontends.bags.compression import unpacked_beginning
from frontends.bags.message import Channel, Message, See, Tell, type_name

_HEADER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 1, 3, 4, 5, 6, 15
_MAGIC_BYTES = 8
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_MOST_BYTES = 1 << 31
_ENCODINGS = ("cdr", "ros1")
"""How messages of ROS are serialised; what JSON or protocol buffers hold is no message of its."""


class _Book:
    """Schemas and channels met so far, and the topics of those whose messages are none of ROS by their encoding."""

    def __init__(self) -> None:
        self.types: dict[int, str] = {}
        self.channels: dict[int, Channel] = {}
        self.foreign: dict[str, set[str]] = {}

    def told(self) -> Iterator[str]:
        """What a person should know of encodings, a sentence each."""
        for encoding, topics in self.foreign.items():
            yield (
                f"messages encoded as {encoding} are left out ({', '.join(sorted(topics))}), "
                f"expected those of ROS, encoded as {' or '.join(_ENCODINGS)}"
            )


def is_of_ros2(path: Path) -> bool:
    """Whether an MCAP file is a recording of ROS 2 by its header, or has no header that says otherwise.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        file.seek(_MAGIC_BYTES)
        operation, content, is_whole = _record(file) or (0, b"", False)
    if operation != _HEADER or not is_whole:
        return True
    try:
        profile, _ = _text(content, 0)
    except (struct.error, _SpoiledError):
        return True
    return profile == "ros2"


def recover(path: Path, types: Collection[str], see: See, tell: Tell) -> Iterator[Message]:
    """Yield the messages of some types in the order of the file, up to where it no longer makes sense.

    Args:
        path: the file.
        types: names of message types as ROS 2 writes them.
        see: told of each channel, once for each of its messages.
        tell: told what was left out.
    """
    book = _Book()
    spoiled = 0
    is_whole = True
    with path.open("rb") as file:
        file.seek(_MAGIC_BYTES)
        while is_whole and (record := _record(file)) is not None:
            operation, content, is_whole = record
            if operation == _DATA_END:
                break
            try:
                yield from _messages(operation, content, book, types, see)
            except (ValueError, KeyError, struct.error, _SpoiledError):
                spoiled += 1
        else:
            tell(f"{path.name}: the file is cut off or damaged at byte {file.tell()}: nothing behind it is read")
    for sentence in book.told():
        tell(f"{path.name}: {sentence}")
    if spoiled:
        tell(f"{path.name}: {spoiled} chunks or records are damaged: what they hold is left out, or may be wrong")


class _SpoiledError(Exception):
    """A chunk whose content is not what was written."""


def _messages(operation: int, content: bytes, book: _Book, types: Collection[str], see: See) -> Iterator[Message]:
    """The messages of one record: of a chunk many."""
    if operation == _CHUNK:
        records, is_sound = _chunk(content)
        for inner_operation, inner in _records(records):
            yield from _messages(inner_operation, inner, book, types, see)
        if not is_sound:
            raise _SpoiledError
    elif operation == _SCHEMA:
        name, _ = _text(content, 2)
        book.types[_short(content, 0)] = type_name(name)
    elif operation == _CHANNEL:
        topic, at = _text(content, 4)
        encoding, _ = _text(content, at)
        name = book.types.get(_short(content, 2), "")
        if encoding not in _ENCODINGS:
            book.foreign.setdefault(encoding, set()).add(topic)
            name = f"{name or 'messages'} as {encoding}"
        book.channels[_short(content, 0)] = Channel(topic, name, is_cdr=encoding == "cdr")
    elif operation == _MESSAGE:
        number, _, logged, _ = _MESSAGE_HEAD.unpack_from(content)
        channel = book.channels[number]
        see(channel, 1)
        if channel.type in types:
            yield Message(channel, 1e-9 * logged, content[_MESSAGE_HEAD.size :])


def _record(file: BinaryIO) -> tuple[int, bytes, bool] | None:
    """The next record of the file, or its beginning, and whether it is whole; None where there is none."""
    head = file.read(_RECORD.size)
    if len(head) < _RECORD.size:
        return None
    operation, length = _RECORD.unpack(head)
    content = file.read(min(length, _MOST_BYTES))
    return operation, content, len(content) == length


def _chunk(content: bytes) -> tuple[bytes, bool]:
    """The records of a chunk, unpacked, and whether they are what was written."""
    _, _, size, checksum = _CHUNK_HEAD.unpack_from(content)
    compression, at = _text(content, _CHUNK_HEAD.size)
    (length,) = struct.unpack_from("<Q", content, at)
    records, is_whole = unpacked_beginning(compression, content[at + 8 : at + 8 + length])
    return records, is_whole and len(records) == size and (not checksum or crc32(records) == checksum)


def _records(chunk: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + _RECORD.size <= len(chunk):
        operation, length = _RECORD.unpack_from(chunk, at)
        at += _RECORD.size
        if at + length > len(chunk):
            raise _SpoiledError
        yield operation, chunk[at : at + length]
        at += length


def _short(content: bytes, at: int) -> int:
    (value,) = struct.unpack_from("<H", content, at)
    return int(value)


def _text(content: bytes, at: int) -> tuple[str, int]:
    """A text preceded by its length, and where it ends."""
    (length,) = struct.unpack_from("<I", content, at)
    end = at + 4 + length
    if end > len(content):
        raise _SpoiledError
    return content[at + 4 : end].decode("utf-8", "replace"), end
