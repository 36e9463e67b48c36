"""What goes wrong when a bag is read."""

from frontends.logs.errors import LogError


class BagError(LogError):
    """A bag that cannot be read, or that holds nothing to map from."""


class MalformedMessageError(BagError):
    """A message whose bytes are none of its type."""
