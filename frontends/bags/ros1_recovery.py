"""A ROS 1 bag record by record, without its index: what was cut off, never indexed, or indexed wrongly.

Source: the format of bags, version 2.0 (wiki.ros.org/Bags/Format/2.0). A record is a header and data, each preceded by
its length; the header's fields are `name=value`, preceded by their length. Chunks hold records of their own.
"""

import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from frontends.bags.compression import unpacked_beginning
from frontends.bags.message import Channel, Message, See, Tell, type_name

_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
_MOST_BYTES = 1 << 31
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")


class _CutOffError(Exception):
    """A record that does not fit into what is there."""


def recover(path: Path, types: Collection[str], see: See, tell: Tell) -> Iterator[Message]:
    """Yield the messages of some types in the order of the file, up to where it no longer makes sense.

    Args:
        path: the file.
        types: names of message types as ROS 2 writes them.
        see: told of each channel, once for each of its messages.
        tell: told what was left out.
    """
    channels: dict[int, Channel] = {}
    spoiled = 0
    is_whole = True
    with path.open("rb") as file:
        file.readline()
        while is_whole and (record := _record(file)) is not None:
            header, data, is_whole = record
            try:
                yield from _messages(header, data, channels, types, see)
            except (_CutOffError, ValueError, KeyError, struct.error):
                spoiled += is_whole
        if not is_whole:
            tell(f"{path.name}: the file is cut off or damaged at byte {file.tell()}: nothing behind it is read")
    if spoiled:
        tell(f"{path.name}: {spoiled} chunks or records are damaged: what cannot be read of them is left out")


def _messages(
    header: dict[bytes, bytes],
    data: bytes,
    channels: dict[int, Channel],
    types: Collection[str],
    see: See,
) -> Iterator[Message]:
    """The messages of one record: of a chunk many."""
    kind = header.get(b"op", b"\0")[0]
    if kind == _CHUNK:
        records, is_whole = unpacked_beginning(header[b"compression"].decode(), data)
        for inner_header, inner in _records(records):
            yield from _messages(inner_header, inner, channels, types, see)
        if not is_whole:
            raise _CutOffError
    elif kind == _CONNECTION:
        said = _fields(data)
        topic, name = header[b"topic"].decode("utf-8", "replace"), said[b"type"].decode("utf-8", "replace")
        channels[_number(header[b"conn"])] = Channel(topic, type_name(name), is_cdr=False)
    elif kind == _MESSAGE:
        channel = channels[_number(header[b"conn"])]
        see(channel, 1)
        if channel.type in types:
            seconds, nanoseconds = _TIME.unpack(header[b"time"])
            yield Message(channel, seconds + 1e-9 * nanoseconds, data)


def _record(file: BinaryIO) -> tuple[dict[bytes, bytes], bytes, bool] | None:
    """The next record of the file, and whether it is whole; None at the file's end."""
    length = file.read(4)
    if not length:
        return None
    try:
        header = _fields(_exactly(file, _number(length)))
        n_bytes = _data_length(header, _number(_exactly(file, 4)))
    except _CutOffError:
        return {}, b"", False
    data = file.read(min(n_bytes, _MOST_BYTES))
    return header, data, len(data) == n_bytes


def _data_length(header: dict[bytes, bytes], stated: int) -> int:
    """Bytes of a record's data; those of an index follow from its count, for some writers stated them wrongly."""
    if header.get(b"op") == b"\x04" and header.get(b"ver") == b"\1\0\0\0" and b"count" in header:
        return 12 * _number(header[b"count"])
    return stated


def _exactly(file: BinaryIO, n: int) -> bytes:
    data = file.read(n) if n < _MOST_BYTES else b""
    if len(data) < n:
        raise _CutOffError
    return data


def _records(chunk: bytes) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    at = 0
    while at < len(chunk):
        header, at = _piece(chunk, at)
        data, at = _piece(chunk, at)
        yield _fields(header), data


def _piece(data: bytes, at: int) -> tuple[bytes, int]:
    """Bytes preceded by their length, and where they end."""
    if at + 4 > len(data):
        raise _CutOffError
    (length,) = _LENGTH.unpack_from(data, at)
    end = at + 4 + length
    if end > len(data):
        raise _CutOffError
    return data[at + 4 : end], end


def _fields(header: bytes) -> dict[bytes, bytes]:
    fields, at = {}, 0
    while at < len(header):
        field, at = _piece(header, at)
        name, _, value = field.partition(b"=")
        fields[name] = value
    return fields


def _number(data: bytes) -> int:
    if len(data) != 4:
        raise _CutOffError
    (value,) = _LENGTH.unpack(data)
    return int(value)
