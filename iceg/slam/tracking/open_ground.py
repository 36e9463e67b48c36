"""Whether a log was taken on open ground, where the laser sees trunks, posts and far walls, and little nearby."""

import numpy as np

from frontends.scan import Log
from iceg.slam.tracking_config import OpenGroundConfig


def is_open_ground(log: Log, config: OpenGroundConfig) -> bool:
    """Whether hardly any beam ends nearby, and most that return come from afar.

    Indoors a laser that sees far meets walls, in halls at least on one side. One that does not, or that loses beams,
    has what returns from nearby.
    """
    ranges = log.ranges[:: max(1, len(log) // config.scans)]
    is_return = ranges >= 0.0
    in_view = len(ranges) * np.count_nonzero(is_return.any(axis=0))  # a beam that never returns is hidden
    near = np.count_nonzero(ranges <= config.near)
    return bool(near < config.max_near_beams * in_view and near < config.max_near_returns * np.count_nonzero(is_return))
