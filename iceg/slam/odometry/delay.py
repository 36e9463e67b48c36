"""By how many scans the odometry is late, or early, where that is more than a linear fit can tell.

A shift moves what odometry claims by the shift times the change of speed: true of a fraction of a scan, no longer of
several, over which a robot may begin a turn and end it. So turns are compared at whole shifts first.
"""

import numpy as np

from graph.arrays import Floats, Ints
from graph.se2 import between, wrap_angle
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.recording.steps import sudden_steps


def whole_delay(turns: Floats, starts: Ints, ends: Ints, odometry: Floats, config: CalibrationConfig) -> int:
    """Scans later at which odometry must be read, to a whole number; 0 where that does not clearly explain more.

    Nor is a delay looked for where odometry jumps, or the log pauses while the robot drives: which of the two it is
    decides whether the step is late, too.

    Args:
        turns: (m,) change of heading between two scans by matches [rad].
        starts: (m,) the first scan of each …
        ends: … and the last one.
        odometry: (n, 3) raw, one pose per scan.
        config: how far is looked, and what it must gain.
    """
    if sudden_steps(odometry, config.sudden).any():
        return 0
    heading = np.concatenate([[0.0], np.cumsum(between(odometry[:-1], odometry[1:])[:, 2])])
    shifts, last = np.arange(-config.max_delay, config.max_delay + 1), len(heading) - 1
    at = np.clip(np.stack([starts, ends])[:, None, :] + shifts[:, None], 0, last)
    differences = wrap_angle(turns - (heading[at[1]] - heading[at[0]]))
    squares = np.mean(np.minimum(np.abs(differences), config.wrong_turn) ** 2, axis=1)
    best = int(np.argmin(squares))
    is_clear = (
        abs(shifts[best]) > config.max_linear_delay and config.delay_gain * squares[best] < squares[config.max_delay]
    )
    return int(shifts[best]) if is_clear else 0
