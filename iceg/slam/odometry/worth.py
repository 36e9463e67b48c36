"""Whether the odometry of a log tells more of the way than the velocity of its robot does.

Wheels that spin on gravel, or a pose that jitters, are off by a third of a step, while the matches before and after
tell how fast the robot goes to a tenth. Along every corridor that hides how far it came such an odometry leads astray.
How well both know the way from key scan to key scan is learned from the same matches, of which neither is told its own.
"""

from dataclasses import replace

import numpy as np

from frontends.scan import Log
from graph.arrays import Floats
from graph.elementary import exp, log
from graph.odometry import OdometryModel
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.velocity import foretold, steps_along
from iceg.slam.track import Track


def error_beside_velocity(track: Track, stamps: Floats, noise: OdometryModel, config: CalibrationConfig) -> float:
    """How many times as large the error of odometry is as that of the velocity, along the way to a key scan.

    Args:
        track: what the front end found.
        stamps: (n_scans,) of the scans [s].
        noise: of the odometry, as the matches tell it.
        config: when the matches tell enough of the velocity.

    Returns:
        The geometric mean over all key scans; 0 where the matches hardly tell of the velocity.
    """
    ahead = steps_along(track, stamps)
    if np.count_nonzero(ahead.are_in_a_row) < config.velocity_min_steps:
        return 0.0
    _, by_velocity = foretold(ahead, config)
    distances, turns = np.array([[key.motion.distance, key.motion.turn] for key in track.keys[1:]]).T
    by_odometry = noise.along_floor**2 + noise.along_per_metre**2 * distances + noise.position_per_radian**2 * turns
    return float(exp(0.5 * (log(by_odometry) - log(by_velocity)).mean()))


def without_odometry(log: Log) -> Log:
    """The same log with a warning instead of its odometry."""
    warning = (
        "the odometry tells less of how far the robot came than its velocity before and after does: it is left out"
    )
    return replace(log, odometry=np.zeros_like(log.odometry), has_odometry=False, warnings=(*log.warnings, warning))
