"""What goes wrong when a trajectory is judged."""

from graph.errors import IcegError


class EvaluationError(IcegError):
    """A reference that cannot be read or does not belong to the trajectory."""
