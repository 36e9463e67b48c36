"""Units of settings, for whoever shows or reads them: a type that says so is a plain number everywhere else."""

import math
from dataclasses import dataclass
from typing import Annotated


@dataclass(frozen=True, slots=True)
class Unit:
    """The unit in which a number is held."""

    symbol: str


RADIAN = Unit("rad")

Radians = Annotated[float, RADIAN]
"""An angle [rad]. Files of settings hold it so; the command line takes and shows degrees."""


def shown_angle(radians: float) -> str:
    """An angle [rad] for a person: degrees, three digits or all before the point."""
    degrees = math.degrees(radians)
    return f"{degrees:.0f}°" if abs(degrees) >= 1000.0 else f"{degrees:.3g}°"
