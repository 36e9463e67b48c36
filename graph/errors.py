"""The root of every error this project raises on purpose, and how errors of others are told."""


class IcegError(Exception):
    """Something the user can act on; each subsystem derives one leaf class from it."""


class GraphError(IcegError):
    """A factor or a pose graph that cannot be optimised as it stands."""


def reason(error: Exception) -> str:
    """What went wrong without the path, for messages that begin with it: OSError alone repeats it, with a number."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
