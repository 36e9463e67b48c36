"""Poses of a source at the times of the scans: between two messages on the arc that joins them."""

import numpy as np
from numpy.typing import NDArray

from graph.se2 import between, compose, expmap, logmap

_GAP_S = 5.0
"""Nothing is known of the way while a source is silent for longer than this [s]."""


def poses_at(times: NDArray[np.float64], poses: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate planar poses at constant twist; before the first, in a gap and behind the last they stay as they are.

    Args:
        times: (m,) of the poses [s], in any order; of equal ones the last counts.
        poses: (m, 3).
        at: (n,) wanted [s].

    Returns:
        (n, 3).
    """
    order = np.argsort(times, kind="stable")
    is_last = np.append(np.diff(times[order]) > 0.0, True)
    times, poses = times[order][is_last], poses[order][is_last]
    if len(times) == 1:
        return np.repeat(poses, len(at), axis=0)
    after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    before = after - 1
    share = np.clip((at - times[before]) / (times[after] - times[before]), 0.0, 1.0)
    share[is_gap(times)[before] & (share < 1.0)] = 0.0
    twist = logmap(between(poses[before], poses[after]))
    return compose(poses[before], expmap(share[:, None] * twist))


def is_gap(times: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(m - 1,) between which of (m,) increasing times a source was silent for so long that nothing is known."""
    return np.asarray(np.diff(times) > _GAP_S)
