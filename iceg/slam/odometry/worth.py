"""Whether the odometry of a log tells more of the way than the velocity of its robot does.

Wheels that spin on gravel, or a pose that jitters, are off by a third of a step, while the matches before and after
tell how fast the robot goes to a tenth. Along every corridor that hides how far it came such an odometry leads astray.
How well both know the way from key scan to key scan is learned from the same matches, of which neither is told its own.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from frontends.scan import Log
from graph.arrays import Floats
from graph.elementary import exp, log
from graph.odometry import OdometryModel, OdometryMotion
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.velocity import foretold, steps_along
from iceg.slam.track import Track


def error_beside_velocity(track: Track, stamps: Floats, noise: OdometryModel, config: CalibrationConfig) -> float:
    """How many times as large the error of odometry is as that of the velocity, along the way to a key scan.

    Args:
        track: what the front end found.
        stamps: (n_scans,) of the scans [s].
        noise: of the odometry, as the matches tell it.
        config: when the matches tell enough of the velocity; the velocity is believed no better than any odometry.

    Returns:
        The geometric mean over all key scans; 0 where the matches hardly tell of velocity or odometry.
    """
    ahead = steps_along(track, stamps)
    is_told = np.count_nonzero(ahead.are_in_a_row) >= config.velocity_min_steps
    if not is_told or noise == OdometryModel():  # as nothing but assumed
        return 0.0
    motions = [key.motion for key in track.keys[1:]]
    _, by_velocity = foretold(ahead, config)
    by_velocity = np.maximum(by_velocity, _along(motions, config.least_noise))
    return float(exp(0.5 * (log(_along(motions, noise)) - log(by_velocity)).mean()))


def _along(motions: Sequence[OdometryMotion], noise: OdometryModel) -> Floats:
    """(n,) variances along the way of motions [m²]."""
    distances, turns = np.array([[motion.distance, motion.turn] for motion in motions]).T
    return np.asarray(
        noise.along_floor**2 + noise.along_per_metre**2 * distances + noise.position_per_radian**2 * turns
    )


def without_odometry(log: Log) -> Log:
    """The same log with a warning instead of its odometry."""
    warning = (
        "the odometry tells less of how far the robot came than its velocity before and after does: it is left out"
    )
    return replace(log, odometry=np.zeros_like(log.odometry), has_odometry=False, warnings=(*log.warnings, warning))
