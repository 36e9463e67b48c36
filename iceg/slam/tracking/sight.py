"""What a scan sees at all: nothing, where the laser is covered; too little to speak against odometry; or enough."""

import numpy as np

from frontends.scan import Scan
from iceg.slam.tracking_config import SightConfig


def sees_nothing(scan: Scan, config: SightConfig) -> bool:
    """Whether no beam returns, or something covers the laser."""
    returns, close = np.count_nonzero(scan.ranges >= 0.0), np.count_nonzero(scan.ranges < config.blind_range)
    return bool(not returns or close > config.blind_share * returns)


def sees_next_to_nothing(scan: Scan, config: SightConfig) -> bool:
    """Whether so few beams return that it means nothing if they match nothing."""
    return bool(np.count_nonzero(scan.ranges >= 0.0) < config.min_returns * len(scan.ranges))


def sees_little(scan: Scan, config: SightConfig) -> bool:
    """Whether few beams return, and not from afar: what they meet may walk along."""
    has_few = bool(np.count_nonzero(scan.ranges >= 0.0) < config.few_returns * len(scan.ranges))
    return has_few and not _sees_afar(scan, config)


def _sees_afar(scan: Scan, config: SightConfig) -> bool:
    return bool(np.count_nonzero(scan.ranges > config.far) > 0.5 * np.count_nonzero(scan.ranges >= 0.0))
