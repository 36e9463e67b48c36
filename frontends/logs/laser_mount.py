"""Where the laser sits on the robot, from the poses or the parameters of a log."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.elementary import cos_sin
from graph.se2 import between, wrap_angle

SILENT = "does not say where the laser sits"
"""What every warning says of a log that leaves it open."""
UNKNOWN = f"the log {SILENT}: at the robot's centre, unless its odometry or log.laser_x and log.laser_y say otherwise"

_SAME_PLACE = 0.02  # m: what rounding and the time between the two poses leave
_SAME_HEADING = math.radians(1.0)
_MOST_SCANS = 0.9
"""Share of the scans whose two recorded poses must tell the same mount."""
_FARTHEST = 100.0  # m: no robot is larger
_MOST_DEGREES = 3600.0


def find(
    T_odom_robot: NDArray[np.float64], T_odom_laser: NDArray[np.float64], parameters: Mapping[str, str], *, rear: bool
) -> tuple[NDArray[np.float64], list[str]]:
    """The pose of the laser on the robot.

    The two poses of a scan's line give it where at least nine in ten scans agree to 2 cm and 1°. Where they do not,
    the "laser pose" is no such thing (some public logs carry the corrected trajectory in its place) and PARAM, else
    the robot's centre, is taken. PARAM also wins where the two poses are simply the same.

    Args:
        T_odom_robot: (n, 3) recorded robot poses.
        T_odom_laser: (n, 3) recorded laser poses; (0, 3) where the messages have none.
        parameters: the PARAM lines of the log.
        rear: whether the rear laser is meant.

    Returns:
        (3,) T_robot_laser, and what a person should know about it.
    """
    stated, warnings = _stated(parameters, rear=rear)
    if len(T_odom_laser) == 0:
        if stated is None:
            warnings.append(UNKNOWN)
        return np.zeros(3) if stated is None else stated, warnings
    T_robot_laser = between(T_odom_robot, T_odom_laser)
    usual = np.median(T_robot_laser[:, :2], axis=0)
    heading = math.atan2(*(float(np.median(part)) for part in reversed(cos_sin(T_robot_laser[:, 2]))))
    off_place = np.hypot(*(T_robot_laser[:, :2] - usual).T)
    off_heading = np.abs(wrap_angle(T_robot_laser[:, 2] - heading))
    agree = (off_place <= _SAME_PLACE) & (off_heading <= _SAME_HEADING)
    if agree.mean() < _MOST_SCANS or np.hypot(*usual) > _FARTHEST:
        taken = "PARAM" if stated is not None else "the robot's centre"
        warnings.append(
            f"the laser's pose moves against the robot's by up to {off_place.max():.2f} m: it is no mounting, "
            f"perhaps a corrected trajectory; the laser's place is taken from {taken}"
        )
        return np.zeros(3) if stated is None else stated, warnings
    mount = _rounded(np.median(T_robot_laser[agree], axis=0))
    if not agree.all():
        warnings.append(
            f"the laser's place on the robot differs in {int((~agree).sum())} scans: the usual one is taken"
        )
    if stated is not None and not _same(mount, stated):
        said = f"PARAM puts the laser at {_shown(stated)}, the two poses of each scan at {_shown(mount)}"
        if not mount.any():
            return stated, [*warnings, f"{said}: PARAM is taken"]
        warnings.append(f"{said}: the poses are taken")
    return mount, warnings


def scanner_parameters(parameters: Mapping[str, str], *, rear: bool) -> dict[str, float]:
    """The numbers that PARAM lines give about the scanner itself, under CARMEN's own names without their prefix."""
    found = {}
    for laser in ("rear_laser", "laser2") if rear else ("front_laser", "laser1"):
        for name in ("resolution", "fov", "flipped"):
            value = _number(parameters, f"laser_{laser}_{name}")
            if math.isfinite(value):
                found[name] = value
    return found


def _number(parameters: Mapping[str, str], name: str) -> float:
    """The value of a parameter, NaN when it is absent or no number."""
    try:
        return float(parameters[name])
    except (KeyError, ValueError):
        return math.nan


def _stated(parameters: Mapping[str, str], *, rear: bool) -> tuple[NDArray[np.float64] | None, list[str]]:
    """What the PARAM lines say, None when nothing."""
    prefix = "robot_rearlaser" if rear else "robot_frontlaser"
    names = (f"{prefix}_offset", f"{prefix}_side_offset", f"{prefix}_angular_offset")
    values = np.array([_number(parameters, name) for name in names])
    warnings = []
    if scanner_parameters(parameters, rear=rear).get("flipped", 0.0) > 0:
        warnings.append("the laser was mounted upside down; CARMEN has put its beams in the usual order already")
    for index, most in enumerate((_FARTHEST, _FARTHEST, _MOST_DEGREES)):
        if abs(values[index]) > most:
            warnings.append(f"{names[index]} is {values[index]:g}, which no laser on a robot has: it is left out")
            values[index] = np.nan
    if np.isnan(values).all():
        return None, warnings
    values = np.nan_to_num(values)
    if abs(values[2]) > 2 * math.pi:
        warnings.append(f"{names[2]} is {values[2]:g}, too much for radians: it is read as degrees")
        values[2] = math.radians(values[2])
    return np.array([values[0], values[1], wrap_angle(float(values[2]))]), warnings


def _same(mount: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    near = math.hypot(*(mount - other)[:2]) <= _SAME_PLACE
    return near and abs(wrap_angle(float(mount[2] - other[2]))) <= _SAME_HEADING


def _shown(mount: NDArray[np.float64]) -> str:
    return f"x {mount[0]:g} m, y {mount[1]:g} m, {math.degrees(mount[2]):g}°"


def _rounded(mount: NDArray[np.float64]) -> NDArray[np.float64]:
    """Free of what six printed decimals of large coordinates leave behind."""
    return np.round(mount, 5) + 0.0


def placed(log: Log, x: float | None, y: float | None, heading: float | None) -> Log:
    """The log with its laser where somebody says it sits.

    Args:
        log: as read.
        x: ahead of the robot's centre [m]; None for what the log says, as for the other two.
        y: to the left of it [m].
        heading: counter-clockwise from straight ahead [rad].
    """
    if x is None and y is None and heading is None:
        return log
    given = (x, y, heading)
    T_robot_laser = [
        known if said is None else said for said, known in zip(given, log.geometry.T_robot_laser.tolist(), strict=True)
    ]
    return replace(
        log,
        geometry=replace(log.geometry, T_robot_laser=np.array(T_robot_laser)),
        warnings=tuple(warning for warning in log.warnings if SILENT not in warning),
        choices={**log.choices, "mount": "as the settings say"},
        is_mount_known=True,
    )
