"""The error of corrections."""

from graph.errors import IcegError


class CorrectionsError(IcegError):
    """Corrections that cannot be read, or do not fit the log."""
