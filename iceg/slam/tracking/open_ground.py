"""Whether a log was taken on open ground, where the laser sees trunks, posts and far walls, and little nearby."""

import numpy as np

from frontends.scan import Log

_NEAR = 10.0
"""Returns from within this are nearby [m] …"""
_FEW = 0.12
"""… on open ground fewer of the beams than this share …"""
_MOSTLY = 0.5
"""… and no more than this share of those that return."""
_JUDGED = 500
"""So many scans, spread over the log, tell."""


def is_open_ground(log: Log) -> bool:
    """Whether hardly any beam ends nearby, and most that return come from afar.

    Indoors a laser that sees far meets walls, in halls at least on one side. One that does not, or that loses beams,
    has what returns from nearby.
    """
    ranges = log.ranges[:: max(1, len(log) // _JUDGED)]
    is_return = ranges >= 0.0
    in_view = len(ranges) * np.count_nonzero(is_return.any(axis=0))  # a beam that never returns is hidden
    near = np.count_nonzero(ranges <= _NEAR)
    return bool(near < _FEW * in_view and near < _MOSTLY * np.count_nonzero(is_return))
