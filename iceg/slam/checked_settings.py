"""What all settings of the SLAM system share: their fields tell their ranges, and are held to them."""

from dataclasses import dataclass
from typing import ClassVar

from graph.errors import IcegError
from graph.ranges import check_marked, check_numbers


class SlamConfigError(IcegError):
    """A setting of the SLAM system outside its range."""


@dataclass(frozen=True, kw_only=True)
class SlamSettings:
    """Settings that are refused outside the ranges that their fields are marked with (`graph.ranges`), or below 0.

    Args:
        prefix: before the names of fields in messages.
    """

    _prefix: ClassVar[str]

    def __init_subclass__(cls, prefix: str = "") -> None:
        cls._prefix = prefix

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError)
        check_marked(self, SlamConfigError, self._prefix)
