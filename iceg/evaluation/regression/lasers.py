"""The lasers of the simulated recordings, from 3.5 m to 80 m; each sees a whole scan in one instant."""

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from frontends.scan import ScanGeometry
from frontends.simulator.laser import Laser


def laser(beams: int, view: float, range_max: float, deviation: float = 0.01) -> Laser:
    """A laser in the middle of the robot.

    Args:
        beams: in a scan.
        view: field of view [°]; of a full circle first and last beam do not coincide.
        range_max: how far it sees [m].
        deviation: of a range [m].
    """
    half = math.radians(0.5 * view)
    bearings = np.linspace(-half, half, beams, endpoint=view < 360.0)
    geometry = ScanGeometry(bearings=bearings, range_min=0.05, range_max=range_max, T_robot_laser=np.zeros(3))
    return Laser(geometry=geometry, range_std=deviation)


LASERS: Mapping[str, Laser] = MappingProxyType(
    {
        "lds": laser(360, 360.0, 3.5),
        "urg": laser(683, 240.0, 5.6),
        "lms8": laser(181, 180.0, 8.0),
        "rplidar": laser(360, 360.0, 12.0),
        "lms30": laser(181, 180.0, 30.0),
        "utm": laser(541, 270.0, 30.0),
        "lms80": laser(361, 180.0, 80.0),
    }
)
"""Each by its name, the shortest first."""
