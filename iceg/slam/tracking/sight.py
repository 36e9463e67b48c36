"""What a scan sees at all: nothing, where the laser is covered; too little to speak against odometry; or enough."""

import numpy as np

from frontends.scan import Scan

BLIND_RANGE = 0.5
"""A scan most of whose beams end within this sees nothing: the laser is covered [m]."""
BLIND_SHARE = 0.8
FEWEST_RETURNS = 0.1
"""A scan with a smaller share of returns sees nothing either …"""
_FEWEST_AFAR = 20
"""… unless so many return, most of them from afar: on open ground a laser of many beams meets little, but sees."""
_FEW_RETURNS = 1.0 / 3.0
"""Where a smaller share of the beams returns, people close by pass for walls …"""
_AFAR = 10.0
"""… but not where most of those that return come from beyond this [m]."""


def is_blind(scan: Scan) -> bool:
    """Whether nearly all beams end at once, or next to none returns: something covers the laser."""
    returns, close = np.count_nonzero(scan.ranges >= 0.0), np.count_nonzero(scan.ranges < BLIND_RANGE)
    if sees_next_to_nothing(scan) and (returns < _FEWEST_AFAR or not _sees_afar(scan)):
        return True
    return bool(close > BLIND_SHARE * returns)


def sees_next_to_nothing(scan: Scan) -> bool:
    """Whether so few beams return that it means nothing if they match nothing."""
    return bool(np.count_nonzero(scan.ranges >= 0.0) < FEWEST_RETURNS * len(scan.ranges))


def sees_little(scan: Scan) -> bool:
    """Whether few beams return, and not from afar: what they meet may walk along."""
    return bool(np.count_nonzero(scan.ranges >= 0.0) < _FEW_RETURNS * len(scan.ranges)) and not _sees_afar(scan)


def _sees_afar(scan: Scan) -> bool:
    return bool(np.count_nonzero(scan.ranges > _AFAR) > 0.5 * np.count_nonzero(scan.ranges >= 0.0))
