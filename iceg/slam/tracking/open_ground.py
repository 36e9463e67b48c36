"""Whether a log was taken on open ground, where the laser sees trunks, posts and far walls, and mostly nothing."""

import numpy as np

from frontends.scan import Log

_FEW = 0.4
"""Share of the beams below which few return …"""
_FAR, _MOSTLY = 10.0, 0.5
"""… and more than this share of those that do come from farther than this [m]."""
_JUDGED = 500
"""So many scans, spread over the log, tell."""


def is_open_ground(log: Log) -> bool:
    """Whether few beams return, and most that do from afar.

    Indoors a laser that sees far meets walls. One that does not, or that loses beams, has returns from nearby.
    """
    ranges = log.ranges[:: max(1, len(log) // _JUDGED)]
    returns, far = np.count_nonzero(ranges >= 0.0), np.count_nonzero(ranges > _FAR)
    return bool(returns < _FEW * ranges.size and far > _MOSTLY * returns)
