"""Arguments of the wrong type, told where they are handed over instead of deep inside."""


def expect(value: object, kind: type | tuple[type, ...], name: str, expected: str) -> None:
    """Refuse an argument of another type.

    Args:
        value: the argument.
        kind: the type it must have, or one of some.
        name: of the argument.
        expected: what it must be, in words.

    Raises:
        TypeError: it is of another.
    """
    if not isinstance(value, kind):
        raise TypeError(f"{name}: found {type_name(value)}, expected {expected}")


def type_name(value: object) -> str:
    """What a value is, for a message."""
    return f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__
