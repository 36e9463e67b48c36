"""Lasers that others than the SICK stand for: beams, reach, rate, sweep and noise as their data sheets have them.

RPLidar A1: SLAMTEC, LD108. LDS-01: ROBOTIS, HLS-LFCD2. URG-04LX: Hokuyo, C-42-3320. Where a sheet states an accuracy as
a bound, half of it is taken for the standard deviation. Periods are multiples of the simulator's step. Depth cameras
whose middle rows a driver makes a scan of are lasers too: Kinect and RealSense D435. Their noise grows with the square
of the range (Khoshelham and Elberink, *Sensors* 12, 2012); here it grows evenly, to about as much at 4 m.
"""

import math
from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from frontends.scan import ScanGeometry
from frontends.simulator.laser import Laser


def sick() -> Laser:
    """SICK LMS200, all beams at once: 181 over 180°, 20 m, 5 Hz."""
    return Laser()


def rplidar_a1() -> Laser:
    """RPLidar A1: 360 beams all around, 12 m, 5.6 Hz, clockwise; 1 % of the range."""
    return Laser(
        geometry=_all_around(range_min=0.15, range_max=12.0),
        period=0.18,
        range_std=0.002,
        range_std_per_metre=0.005,
        quantisation=0.001,
        beam_width=math.radians(1.0),
        sweep_time=-0.18 * 359 / 360,
    )


def lds_01() -> Laser:
    """LDS-01: 360 beams all around, 3.5 m, 5 Hz, counter-clockwise; 3.5 % of the range."""
    return Laser(
        geometry=_all_around(range_min=0.12, range_max=3.5),
        period=0.2,
        range_std=0.005,
        range_std_per_metre=0.01,
        quantisation=0.001,
        beam_width=math.radians(1.0),
        sweep_time=0.2 * 359 / 360,
    )


def urg_04lx() -> Laser:
    """URG-04LX: 683 beams over 240°, 4 m, 10 Hz, counter-clockwise, two thirds of a turn; 1 % of the range."""
    half = math.radians(120.0)
    return Laser(
        geometry=ScanGeometry(
            bearings=np.linspace(-half, half, 683),
            range_min=0.06,
            range_max=4.0,
            T_robot_laser=np.array([0.16, 0.0, 0.0]),
        ),
        period=0.1,
        range_std=0.003,
        range_std_per_metre=0.004,
        quantisation=0.001,
        beam_width=math.radians(0.36),
        sweep_time=0.1 * 240 / 360,
    )


def kinect() -> Laser:
    """Kinect: 640 beams over 57°, 0.45 to 8 m, all at once, ten scans a second; 2.6 cm at 4 m."""
    return _depth_camera(57.0, range_min=0.45, range_std_per_metre=0.006)


def realsense_d435() -> Laser:
    """RealSense D435: 640 beams over 86°, 0.2 to 8 m, all at once, ten scans a second; 3.4 cm at 4 m."""
    return _depth_camera(86.0, range_min=0.2, range_std_per_metre=0.008)


LASERS: MappingProxyType[str, Callable[[], Laser]] = MappingProxyType(
    {
        "sick": sick,
        "rplidar-a1": rplidar_a1,
        "lds-01": lds_01,
        "urg-04lx": urg_04lx,
        "kinect": kinect,
        "realsense-d435": realsense_d435,
    }
)
"""The lasers that a scene can name."""


def like_which(laser: Laser) -> tuple[str, Laser]:
    """Name of the one whose beams and reach a laser has, and that one; the SICK for a laser of none of them."""
    for name, make in LASERS.items():
        named = make()
        same_reach = laser.geometry.range_max == named.geometry.range_max
        if same_reach and np.array_equal(laser.geometry.bearings, named.geometry.bearings):
            return name, named
    return "sick", sick()


def _depth_camera(view: float, range_min: float, range_std_per_metre: float) -> Laser:
    """One that sees so wide [°]."""
    half = math.radians(0.5 * view)
    return Laser(
        geometry=ScanGeometry(
            bearings=np.linspace(-half, half, 640),
            range_min=range_min,
            range_max=8.0,
            T_robot_laser=np.array([0.1, 0.0, 0.0]),
        ),
        period=0.1,
        range_std=0.002,
        range_std_per_metre=range_std_per_metre,
        quantisation=0.001,
        beam_width=math.radians(view / 640),
    )


def _all_around(range_min: float, range_max: float) -> ScanGeometry:
    return ScanGeometry(
        bearings=np.linspace(-math.pi, math.pi, 361)[:-1],
        range_min=range_min,
        range_max=range_max,
        T_robot_laser=np.zeros(3),
    )
