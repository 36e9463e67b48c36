"""The error of the server."""

from graph.errors import IcegError


class ViewError(IcegError):
    """A page that cannot be served."""
