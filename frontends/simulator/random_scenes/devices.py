"""Lasers and wheels as one finds them on robots, from the coarse to the fine and from the good to the poor."""

import math
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from frontends.scan import ScanGeometry
from frontends.simulator.laser import Laser
from frontends.simulator.lasers import lds_01, rplidar_a1, urg_04lx
from frontends.simulator.robot import OdometryModel

Quality = Literal["good", "fair", "poor", "none"]


def sick(n_beams: int, range_max: float, range_std: float = 0.01) -> Laser:
    """A SICK of so many beams over 180° and so long a reach [m], all beams at once."""
    return Laser(geometry=_fan(n_beams, 180.0, range_max), range_std=range_std)


def utm_30lx() -> Laser:
    """Hokuyo UTM-30LX: 1081 beams over 270°, 30 m, 10 Hz, counter-clockwise."""
    return Laser(geometry=_fan(1081, 270.0, 30.0), period=0.1, range_std=0.01, quantisation=0.001, sweep_time=0.02)


DEVICES: MappingProxyType[str, Callable[[], Laser]] = MappingProxyType(
    {
        "sick-8m": lambda: sick(181, 8.0, range_std=0.008),
        "sick-30m": lambda: sick(181, 30.0),
        "sick-80m": lambda: sick(361, 80.0),
        "utm-30lx": utm_30lx,
        "rplidar-a1": rplidar_a1,
        "lds-01": lds_01,
        "urg-04lx": urg_04lx,
    }
)
"""The lasers that a random scene draws from."""

_ERRORS: MappingProxyType[Quality, float] = MappingProxyType({"good": 1.0, "fair": 3.0, "poor": 7.0, "none": 7.0})
"""How many times as wrong as good wheels they are."""


def random_laser(rng: np.random.Generator, least_reach: float = 0.0) -> tuple[str, Laser]:
    """One of `DEVICES` that reaches so far [m], mounted somewhere ahead, turning either way; its name and itself."""
    names = [name for name, make in DEVICES.items() if make().geometry.range_max >= least_reach]
    name = names[rng.integers(len(names))]
    laser = DEVICES[name]()
    mount = np.array([rng.uniform(-0.1, 0.25), rng.normal(0.0, 0.01), rng.normal(0.0, 0.003)])
    direction = 1.0 if rng.random() < 0.5 else -1.0
    geometry = replace(laser.geometry, T_robot_laser=mount)
    return name, replace(laser, geometry=geometry, sweep_time=direction * laser.sweep_time)


def random_odometry(rng: np.random.Generator) -> tuple[Quality, OdometryModel]:
    """How good the wheels are, and in which way they are wrong; of wheels that report nothing, how they would be."""
    quality = list(_ERRORS)[rng.integers(len(_ERRORS))]
    times = _ERRORS[quality]
    return quality, OdometryModel(
        translation_scale=1.0 + rng.normal(0.0, 0.006 * times),
        rotation_scale=1.0 + rng.normal(0.0, 0.008 * times),
        heading_drift=math.radians(rng.normal(0.0, 0.08 * times)),
        translation_std=0.012 * times,
        rotation_std=0.015 * times,
        drift_std=math.radians(0.15 * times),
        slip_std=0.01 * times,
    )


def _fan(n_beams: int, field_of_view: float, range_max: float) -> ScanGeometry:
    """Beams evenly spread over a field of view [°], straight ahead in its middle."""
    half = math.radians(field_of_view / 2)
    return ScanGeometry(bearings=np.linspace(-half, half, n_beams), range_min=0.05, range_max=range_max)
