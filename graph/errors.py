"""The root of every error this project raises on purpose."""


class IcegError(Exception):
    """Something the user can act on; each subsystem derives one leaf class from it."""


class GraphError(IcegError):
    """A factor or a pose graph that cannot be optimised as it stands."""
