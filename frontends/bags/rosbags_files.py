"""One file of a bag, read by the rosbags library through the file's own index."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from frontends.bags.message import Channel, Message, See


def read(path: Path, container: str, types: Collection[str], see: See) -> Iterator[Message]:
    """Yield the messages of some types, in the order of their recording.

    Args:
        path: the file.
        container: "ros1", "sqlite3" or "mcap".
        types: names of message types as ROS 2 writes them.
        see: told of every channel, and how many messages came over it.

    Raises:
        Exception: whatever rosbags raises where a file is damaged.
    """
    reader = bag_reader(path, container)
    reader.open()
    try:
        is_cdr = container != "ros1"
        wanted, channels = [], {}
        for connection in reader.connections:
            channel = channels[connection.id] = Channel(connection.topic, connection.msgtype, is_cdr)
            see(channel, connection.msgcount)
            if connection.msgtype in types and connection.msgcount:
                wanted.append(connection)
        if not wanted:
            return
        for connection, recorded, data in reader.messages(wanted):
            yield Message(channels[connection.id], 1e-9 * recorded, data)
    finally:
        reader.close()


def bag_reader(path: Path, container: str) -> Any:  # noqa: ANN401
    """The reader of rosbags for one file, still to be opened: its own choice goes by the name, which may be any."""
    if container == "ros1":
        from rosbags.rosbag1 import Reader

        return Reader(path)
    if container == "sqlite3":
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

        return Sqlite3Reader(path)
    from rosbags.rosbag2.storage_mcap import McapReader

    return McapReader(path)
