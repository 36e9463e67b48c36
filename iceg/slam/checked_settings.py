"""What all settings of the SLAM system share: their fields tell their ranges, and are held to them."""

from dataclasses import dataclass

from graph.errors import IcegError
from graph.ranges import CheckedSettings


class SlamConfigError(IcegError):
    """A setting of the SLAM system outside its range."""


@dataclass(frozen=True, kw_only=True)
class SlamSettings(CheckedSettings, error=SlamConfigError):
    """Settings of the SLAM system."""
