"""How the containers of bags begin."""

ZSTD = b"\x28\xb5\x2f\xfd"
"""A file, or a message, that was packed as a whole."""
_CONTAINERS = {b"#ROSBAG V": "ros1", b"SQLite format 3\0": "sqlite3", b"\x89MCAP0\r\n": "mcap"}


def container(head: bytes) -> str | None:
    """The name of the container that a file which begins with `head` is; None for anything else."""
    return next((name for magic, name in _CONTAINERS.items() if head.startswith(magic)), None)


def is_bag(head: bytes) -> bool:
    """Whether a file that begins with `head` is a bag, or something packed as ROS 2 packs bags."""
    return container(head) is not None or head.startswith(ZSTD)
