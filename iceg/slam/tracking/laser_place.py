"""Where the laser sits on the robot, where the log does not say it, or says it wrongly.

A robot turns about its own centre, and its odometry is of that: a laser that sits elsewhere moves as the robot turns.
So the calibration of the odometry finds the place (Censi et al., *Simultaneous calibration of odometry and sensor
parameters for mobile robots*, 2013): within millimetres for good odometry, centimetres where wheels slip, several times
what the fit claims, as what persists of their errors is none of its noise.
"""

import math
from dataclasses import replace

import numpy as np

from frontends.logs.laser_mount import SILENT
from frontends.scan import Log
from graph.arrays import Floats
from graph.noise import chi2_gate
from graph.se2 import compose
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.calibration import OdometryCalibration, calibrate_odometry
from iceg.slam.run_warning import RunWarning
from iceg.slam.track import Track


def placed_by_odometry(log: Log, track: Track, config: CalibrationConfig) -> Log | None:
    """The log with its laser where the odometry says it sits.

    Args:
        log: as it was tracked.
        track: of it.
        config: what it takes to be believed.

    Returns:
        The log, which says so among its warnings, to be tracked again: its trajectory is that of the robot now. None
        where it says itself where the laser sits, or the odometry does not tell it, or puts it where it is taken to be.
    """
    if log.is_mount_known or not log.has_odometry:
        return None
    found = calibrate_odometry(track, log.odometry, config)
    if not _is_elsewhere(found, config.mount_floor, config):
        return None
    T_robot_laser = _place(found, log)
    place = _in_words(T_robot_laser)
    sentence = f"the log {SILENT}: {place}, as its odometry tells; the trajectory is that of the robot's centre"
    return replace(
        log,
        geometry=replace(log.geometry, T_robot_laser=T_robot_laser),
        warnings=(*(warning for warning in log.warnings if SILENT not in warning), sentence),
        choices={**log.choices, "mount": f"{place}, as the odometry tells"},
    )


def place_warning(log: Log, found: OdometryCalibration, config: CalibrationConfig) -> RunWarning | None:
    """What to say where a log says where its laser sits, and its odometry puts it elsewhere; None where it does not.

    Args:
        log: as it was tracked.
        found: by its matches.
        config: what it takes.
    """
    if not (log.is_mount_known and log.has_odometry and _is_elsewhere(found, config.mount_doubt, config)):
        return None
    said, place = _in_words(log.geometry.T_robot_laser), _in_words(_place(found, log))
    sentence = (
        f"the laser sits {said}, the log says; its odometry says {place}; log.laser_x and log.laser_y overrule the log"
    )
    return RunWarning(kind="laser place", sentence=sentence)


def _is_elsewhere(found: OdometryCalibration, farther: float, config: CalibrationConfig) -> bool:
    """Whether odometry puts the laser farther than so from where it is taken to sit [m], and not by chance."""
    offset = np.array(found.T_odometry_laser[:2])
    distance2 = float(((offset / np.array(found.laser_deviations)) ** 2).sum())
    return distance2 > chi2_gate(config.mount_false_alarm, freedom=2) and math.hypot(*offset) > farther


def _place(found: OdometryCalibration, log: Log) -> Floats:
    """(3,) T_robot_laser by the odometry; which way the laser looks is left as it is."""
    return compose(np.array([*found.T_odometry_laser[:2], 0.0]), log.geometry.T_robot_laser)


def _in_words(T_robot_laser: Floats) -> str:
    x, y = T_robot_laser[:2].tolist()
    along, aside = "ahead of" if x >= 0.0 else "behind", "left" if y >= 0.0 else "right"
    return f"{abs(x):.2f} m {along} the robot's centre and {abs(y):.2f} m to its {aside}"
