"""A serialised message and the channel it came over."""

from collections.abc import Callable
from typing import NamedTuple


class Channel(NamedTuple):
    """What messages come over.

    Attributes:
        topic: its name.
        type: of its messages, as ROS 2 writes it.
        is_cdr: whether they are serialised as ROS 2 does, else as ROS 1.
    """

    topic: str
    type: str
    is_cdr: bool


class Message(NamedTuple):
    """One message as recorded.

    Attributes:
        channel: where it came from.
        recorded: when it was written [s].
        data: its bytes.
    """

    channel: Channel
    recorded: float
    data: bytes


def type_name(name: str) -> str:
    """The name of a type as ROS 2 writes it: ROS 1 leaves the middle word out."""
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else name


See = Callable[[Channel, int], None]
"""Told of a channel, and of how many of its messages."""
Tell = Callable[[str], None]
"""Told what a person should know, a sentence at a time."""
