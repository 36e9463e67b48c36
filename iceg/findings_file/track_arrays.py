"""A track as arrays."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.measurement import NoMatch
from graph.odometry import OdometryMotion
from iceg.findings_file.match_arrays import match_arrays, matches_of
from iceg.findings_file.table import Table
from iceg.slam.track import KeyScan, Track


def track_arrays(track: Track) -> dict[str, NDArray[Any]]:
    """The arrays of a track."""
    keys, motions = track.keys, [key.motion for key in track.keys]
    return {
        "key_scan": np.array([key.index for key in keys], dtype=np.uint32),
        "key_anchor": np.array([key.anchor for key in keys], dtype=np.int32),
        "key_T_track_robot": np.array([key.T_track_robot for key in keys]),
        "key_motion_T": np.array([motion.T_key_robot for motion in motions]),
        "key_motion_covariance": np.array([motion.covariance for motion in motions]),
        "key_motion_path": np.array([(motion.distance, motion.turn) for motion in motions]),
        **match_arrays("key_match", [None if isinstance(key.match, NoMatch) else key.match for key in keys]),
        "scan_key": track.key_of_scan.astype(np.uint32),
        "scan_T_key": track.T_key_scan,
    }


def track_facts(track: Track) -> dict[str, Any]:
    """What there is to say of a track besides arrays, for JSON."""
    return {
        "no_match_reasons": [key.match.reason for key in track.keys if isinstance(key.match, NoMatch)],
        "failures": track.failures,
        "lost": list(map(int, track.lost)),
        "breaks": list(map(int, track.breaks)),
        "unknown_motion": list(map(int, track.unknown_motion)),
        "dead": [list(map(int, interval)) for interval in track.dead],
        "match_covariance_scale": track.match_covariance_scale,
    }


def track_of(table: Table, facts: Mapping[str, Any], log: Log) -> Track:
    """The track again.

    Raises:
        IcegError: the arrays or facts make no track of the log.
    """
    n_scans = len(log)
    scans = table.whole("key_scan", -1, high=n_scans)
    n_keys = len(scans)
    key_of_scan = table.whole("scan_key", n_scans, high=n_keys)
    if n_keys == 0 or (np.diff(scans) <= 0).any() or (np.diff(key_of_scan) < 0).any():
        raise table.error("its key scans are none, or not in the order of the log")
    anchors = table.whole("key_anchor", n_keys, low=-1, high=n_keys)
    poses = table.floats("key_T_track_robot", n_keys, 3)
    motions = table.floats("key_motion_T", n_keys, 3)
    covariances = table.floats("key_motion_covariance", n_keys, 3, 3)
    paths = table.floats("key_motion_path", n_keys, 2).tolist()
    matches = matches_of(table, "key_match", n_keys)
    reasons = iter(map(str, facts["no_match_reasons"]))
    return Track(
        keys=[
            KeyScan(
                index=scan,
                scan=log.scan(scan),
                motion=OdometryMotion(
                    T_key_robot=motions[key],
                    covariance=covariances[key],
                    distance=paths[key][0],
                    turn=paths[key][1],
                ),
                match=matches[key] or NoMatch(reason=next(reasons, "")),
                anchor=int(anchors[key]),
                T_track_robot=poses[key],
            )
            for key, scan in enumerate(scans.tolist())
        ],
        key_of_scan=key_of_scan,
        T_key_scan=table.floats("scan_T_key", n_scans, 3),
        failures=int(facts["failures"]),
        lost=_scans(table, facts["lost"], n_scans),
        breaks=_scans(table, facts["breaks"], n_scans),
        unknown_motion=_scans(table, facts["unknown_motion"], n_scans),
        dead=[(first, last) for first, last in (_scans(table, each, n_scans) for each in facts["dead"])],
        match_covariance_scale=float(facts["match_covariance_scale"]),
    )


def _scans(table: Table, found: Any, n_scans: int) -> list[int]:  # noqa: ANN401
    scans = list(map(int, found))
    if any(not 0 <= scan < n_scans for scan in scans):
        raise table.error(f"found scans {str(scans)[:80]}, expected 0 to {n_scans - 1}")
    return scans
