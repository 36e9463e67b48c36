"""Scans around a break of the path: which belong to the key scan before it, which to the one after."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from frontends.scan import Log
from graph.se2 import between, compose
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.slam.broken_path.path_break import Break
from iceg.slam.track import Track

_AROUND = 5
"""Key scans on either side of a break that show what is there."""


def reassigned(track: Track, breaks: Iterable[Break], log: Log, matcher: IceMatcher) -> Track:
    """Tie the scans that were taken after a break, but before the next key scan, to that one.

    Where the break is known to the scan, tracking put those after it where it took the robot to be before: they lie as
    odometry says.

    Args:
        track: what the front end found; each scan hangs on the key scan before it.
        breaks: of its path.
        log: with the scans.
        matcher: judges which side a scan agrees with.

    Returns:
        The same track, with some scans tied to the key scan that follows.
    """
    key_of_scan, T_key_scan = track.key_of_scan.copy(), track.T_key_scan.copy()
    for found in breaks:
        key = found.key
        first, last = track.keys[key - 1].index + 1, track.keys[key].index
        scan = found.scan
        moved = np.arange(first + _scans_before(track, key, log, matcher) if scan is None else scan, last)
        key_of_scan[moved] = key
        if scan is not None and log.has_odometry:
            T_key_scan[moved] = between(log.odometry[last], log.odometry[moved])
        else:
            T_after_before = between(track.keys[key].T_track_robot, track.keys[key - 1].T_track_robot)
            T_key_scan[moved] = compose(T_after_before, track.T_key_scan[moved])
    return replace(track, key_of_scan=key_of_scan, T_key_scan=T_key_scan)


def _scans_before(track: Track, key: int, log: Log, matcher: IceMatcher) -> int:
    """How many scans between two key scans belong to the first: the split at which most beams agree."""
    before = _local_map(track, range(max(0, key - _AROUND), key), key - 1, matcher)
    after = _local_map(track, range(key, min(len(track.keys), key + _AROUND)), key, matcher)
    T_after_before = between(track.keys[key].T_track_robot, track.keys[key - 1].T_track_robot)
    gains = []
    for index in range(track.keys[key - 1].index + 1, track.keys[key].index):
        scan, T_before_scan = log.scan(index), track.T_key_scan[index]
        there = matcher.agreement(before, scan, T_before_scan)
        here = matcher.agreement(after, scan, compose(T_after_before, T_before_scan))
        gains.append(there.inliers - here.inliers)
    return int(np.argmax(np.concatenate([[0], np.cumsum(gains)])))


def _local_map(track: Track, members: range, base: int, matcher: IceMatcher) -> LocalMap:
    placed = between(track.keys[base].T_track_robot, track.T_track_keys[members])
    return matcher.prepare([track.keys[member].scan for member in members], placed)
