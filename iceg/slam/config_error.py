"""The error of a setting out of its range."""

from graph.errors import IcegError


class SlamConfigError(IcegError):
    """A setting of the SLAM system outside its range."""
