"""What goes wrong when a log is read."""

from pathlib import Path

from graph.errors import IcegError


class LogError(IcegError):
    """A log that cannot be read as what it is said to be."""


class MalformedLineError(LogError):
    """One line that breaks its format.

    Args:
        found: what stands there.
        expected: what the format wants there.
    """

    def __init__(self, found: str, expected: str) -> None:
        super().__init__(f"found {found}, expected {expected}")
        self.found = found
        self.expected = expected

    def at(self, path: Path, line: int) -> LogError:
        """The same statement with the place it belongs to."""
        return LogError(f"{path}:{line}: {self}")
