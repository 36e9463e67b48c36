"""Where the laser sits on the robot, where the log does not say it.

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
from graph.noise import chi2_gate
from graph.se2 import compose
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.calibration import calibrate_odometry
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
    offset = np.array(found.T_odometry_laser[:2])
    distance2 = float(((offset / np.array(found.laser_deviations)) ** 2).sum())
    if distance2 <= chi2_gate(config.mount_false_alarm, freedom=2) or math.hypot(*offset) <= config.mount_floor:
        return None
    T_robot_laser = compose(np.array([*offset, 0.0]), log.geometry.T_robot_laser)
    place = _in_words(*T_robot_laser[:2].tolist())
    sentence = f"the log {SILENT}: {place}, as its odometry tells; the trajectory is that of the robot's centre"
    return replace(
        log,
        geometry=replace(log.geometry, T_robot_laser=T_robot_laser),
        warnings=(*(warning for warning in log.warnings if SILENT not in warning), sentence),
        choices={**log.choices, "mount": f"{place}, as the odometry tells"},
    )


def _in_words(x: float, y: float) -> str:
    along, aside = "ahead of" if x >= 0.0 else "behind", "left" if y >= 0.0 else "right"
    return f"{abs(x):.2f} m {along} the robot's centre and {abs(y):.2f} m to its {aside}"
