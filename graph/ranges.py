"""Ranges that numbers must keep to: those in files, and those among the settings."""

import dataclasses
import math
from typing import TYPE_CHECKING, ClassVar, TypeVar

from graph.errors import IcegError
from graph.short_repr import changed_repr

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

LEAST, MOST = 1e-9, 1e6
"""No positive setting is smaller, and none larger, whatever its unit (m, rad, s, a count, a share) …"""
MOST_COUNT = 10**9
"""… but for whole numbers."""
RATES = (1e-9, 0.5)
"""Least and most of a rate of false alarms."""

Number = TypeVar("Number", int, float)


def number_in(text: str, low: float, high: float, what: str, error: type[IcegError], where: str = "") -> float:
    """A number out of a file that must lie in a range.

    Args:
        text: what stands there.
        low: the least.
        high: the most.
        what: the number is, with its unit.
        error: raised where it is none, or lies elsewhere.
        where: file and line, for the message.

    Raises:
        IcegError: of the type given, with what was found and what was expected.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        place = f"{where}: " if where else ""
        raise error(f"{place}found '{text[:40]}', expected {what} from {low:g} to {high:g}")
    return value


@dataclasses.dataclass(frozen=True, kw_only=True)
class CheckedSettings:
    """Settings refused outside the ranges that their fields are marked with (`between`, `positive`), or below 0.

    Args:
        error: raised where a number is out of range; what the class derives from says it, if left out.
        prefix: before the names of fields in messages.
    """

    _error: ClassVar[type[IcegError]] = IcegError
    _prefix: ClassVar[str] = ""

    def __init_subclass__(cls, *, error: type[IcegError] | None = None, prefix: str = "") -> None:
        super().__init_subclass__()
        # Set here, for `dataclass` writes one of its own into every class that has none, whatever it inherits.
        cls.__repr__ = changed_repr  # type: ignore[method-assign,assignment]
        cls._error, cls._prefix = error or cls._error, prefix

    def __post_init__(self) -> None:
        check_numbers(self, self._error)
        check_marked(self, self._error, self._prefix)


def between(default: Number, least: float, most: float) -> Number:
    """A field of a dataclass of settings that must lie in a range, both ends counted in; see `check_marked`."""
    return dataclasses.field(default=default, metadata={"bounds": (least, most)})


def positive(default: Number, least: float = 0.0, most: float = math.inf) -> Number:
    """The same of one that must not be zero either, and is told so first."""
    return dataclasses.field(default=default, metadata={"bounds": (least, most), "positive": True})


def check_marked(settings: "DataclassInstance", error: type[IcegError], prefix: str = "") -> None:
    """Refuse numbers that lie outside the ranges that `between` and `positive` mark their fields with.

    Args:
        settings: the dataclass; what it nests checks itself.
        error: raised where a number is out of range.
        prefix: before the name of the field, in the message.

    Raises:
        IcegError: of the type given, with the field, what was found and what was expected.
    """
    marks = {field.name: field.metadata["bounds"] for field in dataclasses.fields(settings) if field.metadata}
    check_between(settings, error, prefix, **marks)


def check_numbers(settings: "DataclassInstance", error: type[IcegError]) -> None:
    """Refuse negative and enormous numbers among the fields of a dataclass of settings, and zero where marked so.

    Args:
        settings: the dataclass; what it nests checks itself.
        error: raised where a number is out of range.

    Raises:
        IcegError: of the type given, with the field, what was found and what was expected.
    """
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        if "positive" in field.metadata and not 0 < value < math.inf:
            least = "1 or more" if isinstance(value, int) else "a positive number"
            raise error(f"found {field.name} {shown_number(value)}, expected {least}")
        if not value >= 0:
            raise error(f"found {field.name} {shown_number(value)}, expected 0 or more")
    check_magnitudes(settings, error)


def check_magnitudes(settings: "DataclassInstance", error: type[IcegError]) -> None:
    """Refuse numbers among the fields that are beyond all sense: too large but not infinite, or positive and too small.

    Args:
        settings: the dataclass; what it nests checks itself.
        error: raised where a number is out of range.

    Raises:
        IcegError: of the type given, with the field, what was found and what was expected.
    """
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, bool) or not isinstance(number, int | float) or field.name == "seed":
                continue
            most = MOST_COUNT if isinstance(number, int) else MOST
            if not (-most <= number <= most or number == math.inf):
                raise error(f"found {field.name} {shown_number(number)}, expected at most {most:g}")
            if 0 < abs(number) < LEAST:
                raise error(f"found {field.name} {shown_number(number)}, expected at least {LEAST:g}, or 0")


def check_between(
    settings: "DataclassInstance", error: type[IcegError], prefix: str = "", **bounds: tuple[float, float]
) -> None:
    """Refuse numbers among the fields that lie outside their own bounds; what is None is left alone.

    Args:
        settings: the dataclass.
        error: raised where a number is out of range.
        prefix: before the name of the field, in the message.
        **bounds: least and most of each field to be looked at.

    Raises:
        IcegError: of the type given, with the field, what was found and what was expected.
    """
    for name, (low, high) in bounds.items():
        value = getattr(settings, name)
        if value is not None and not low <= value <= high:
            raise error(f"found {prefix}{name} {shown_number(value)}, expected a number from {low:g} to {high:g}")


def shown_number(value: float) -> str:
    """For messages: a number, of a whole one with very many digits how many."""
    if isinstance(value, int) and abs(value) >= 10**30:
        return f"a whole number of {value.bit_length() * 30103 // 100000 + 1} digits"
    return str(value)
