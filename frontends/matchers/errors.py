"""What can be wrong with a rival matcher before it sees a scan."""

from graph.errors import IcegError


class MatcherError(IcegError):
    """An unknown matcher, a setting outside its range, or a reference without scans."""


def require(condition: bool, message: str) -> None:
    """Raise `MatcherError` with a message unless the condition holds."""
    if not condition:
        raise MatcherError(message)
