"""What is wrong with arguments that are each right."""


class UsageError(Exception):
    """Arguments that do not belong together."""
