"""Time from scan to scan, in usual ones: the stamps of many logs jitter, and only tell where scans are missing."""

import numpy as np

from graph.arrays import Floats
from graph.elementary import log

_LEAST_CHANGE = 1e-3
"""Steps of robots differ by this at least [m]."""


def usual_interval(stamps: Floats) -> float | None:
    """Median time from scan to scan [s]; None where the stamps do not advance."""
    steps = _advances(stamps)
    advancing = steps[steps > 0.0]
    return float(np.median(advancing)) if 2 * len(advancing) > len(steps) else None


def waits(stamps: Floats) -> Floats:
    """(n - 1,) time from each of n scans to the next, in usual intervals, at least one."""
    usual, steps = usual_interval(stamps), _advances(stamps)
    return np.ones(len(steps)) if usual is None else np.maximum(1.0, steps / usual)


def _advances(stamps: Floats) -> Floats:
    """(n - 1,) by how much each of n stamps is later than all before it: one that steps back makes no pause [s]."""
    return np.diff(np.maximum.accumulate(stamps))


def confirmed_intervals(stamps: Floats, lengths: Floats) -> Floats:
    """Whole intervals from scan to scan, but all 1 where a robot goes no farther the longer a scan is in coming.

    Some recorders stamp scans when they get round to it. So two likelihoods are compared over the scans that come late:
    that the robot went on as fast as just before and after, and that it went as far, changes of speed by Cauchy's law.

    Args:
        stamps: (n,) of the scans [s].
        lengths: (n - 1,) how far the robot went from each scan to the next [m].

    Returns:
        (n - 1,) more than 1 where scans are missing.
    """
    pauses = np.round(waits(stamps))
    is_late = pauses[1:-1] > 1.0
    if not is_late.any():
        return pauses
    by_time, by_scan = (_changes(lengths / each, each) for each in (pauses, np.ones(len(pauses))))
    scale = max(float(np.median(by_scan)), _LEAST_CHANGE)
    costs = [log(1.0 + (change[is_late] / scale) ** 2).sum() for change in (by_time, by_scan)]
    return pauses if costs[0] <= costs[1] else np.ones(len(pauses))


def _changes(speeds: Floats, pauses: Floats) -> Floats:
    """(n - 2,) by how much each but the first and last step is longer or shorter than at the speed around it [m]."""
    return np.abs(speeds[1:-1] - 0.5 * (speeds[:-2] + speeds[2:])) * pauses[1:-1]
