"""What counts as one straight wall, and as a corner."""

import math
from dataclasses import dataclass

from graph.errors import IcegError


class FloorPlanError(IcegError):
    """A floor plan that cannot be drawn."""


@dataclass(frozen=True, kw_only=True)
class FloorPlanConfig:
    """Lengths and angles of a floor plan."""

    off_line: float = 0.03
    """A piece of wall belongs to a straight wall if both its ends lie nearer to its line than this [m]."""
    turned: float = math.radians(12.0)
    """It is turned against the wall by no more than this [rad]; pieces shorter than 0.15 m may be by twice as much."""
    gap: float = 0.3
    """Pieces no farther apart than this along the line are one wall [m]: less than a door."""
    thinnest: float = 0.025
    """Two faces of a wall that lie nearer to each other than this are drawn as one line [m]."""
    corner_reach: float = 0.25
    """Ends that fall short of the line of another wall by no more than this, or pass it so far, are led to it [m]."""
    least_corner: float = math.radians(15.0)
    """Walls that meet at a smaller angle make no corner [rad]."""
    least_length: float = 0.2
    """Shorter ones are left out [m]."""
    sure_length: float = 0.4
    """Walls at least so long [m] …"""
    sure_key_poses: float = 3.0
    """… that were seen from at least so many key poses on average along them …"""
    sure_points: float = 40.0
    """… with at least so many points a metre [1/m] are beyond doubt."""
