"""The error of files of findings."""

from graph.errors import IcegError


class FindingsError(IcegError):
    """A file of findings that cannot be read."""
