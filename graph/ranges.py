"""Ranges that numbers among the settings must keep to."""

import dataclasses
import math
from typing import TYPE_CHECKING

from graph.errors import IcegError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def check_numbers(settings: "DataclassInstance", error: type[IcegError], *, positive: tuple[str, ...] = ()) -> None:
    """Refuse negative numbers among the fields of a dataclass of settings.

    Args:
        settings: the dataclass; what it nests checks itself.
        error: raised where a number is out of range.
        positive: fields that must not be zero or infinite either.

    Raises:
        IcegError: of the type given, with the field, what was found and what was expected.
    """
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        if field.name in positive and not 0 < value < math.inf:
            least = "1 or more" if isinstance(value, int) else "a positive number"
            raise error(f"found {field.name} {value}, expected {least}")
        if not value >= 0:
            raise error(f"found {field.name} {value}, expected 0 or more")
