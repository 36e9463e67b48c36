"""Scans between two key scans, smoothed: matches say where each of them is, odometry how one leads to the next.

The match of a single scan errs by a millimetre or two, each in its own way, and odometry errs as little from scan to
scan. Key scans are tied to each other by the graph and to the walls, and stay where they are.
"""

import math
from dataclasses import replace

import numpy as np

from graph import dense
from graph.arrays import Floats
from graph.elementary import cos_sin
from graph.noise import chi2_gate
from graph.se2 import between, wrap_angle
from iceg.slam.odometry.noise import robust_deviation
from iceg.slam.track import Track
from iceg.slam.tracking import _smoothing_kernels as kernels
from iceg.slam.tracking_config import SmoothingConfig

_LEAST_MOVED = 1e-4
"""Odometry errs by no less than this share of what steps and matches differ by, squared."""


def smoothed_between_keys(track: Track, odometry: Floats, config: SmoothingConfig) -> Track:
    """The track with the most probable poses of the scans between key scans.

    How much either errs is learned from the log: two steps in a row share the error of the match between them, with
    opposite signs, so that minus their covariance is its variance; the rest is odometry's. Each axis is taken by itself
    in the frame of the key scan. Where that covariance is not negative beyond chance, matches err together or odometry
    tells next to nothing beside them: they stay as they are.

    Args:
        track: of a log with odometry.
        odometry: (n_scans, 3) calibrated.
        config: what is a slip, and what is chance.

    Returns:
        The same, but for `T_key_scan`.
    """
    firsts, part_of = track.key_scans, track.key_of_scan
    steps = _steps(track.T_key_scan, odometry)
    follows = np.flatnonzero(part_of[1:] == part_of[:-1]) + 1
    if len(follows) < 2:
        return track
    T_track_keys, ends = track.T_track_keys, np.full((len(firsts), 3), np.nan)
    ends[:-1] = between(T_track_keys[:-1], T_track_keys[1:])
    arrived = track.T_key_scan.copy()
    arrived[firsts[1:]] = ends[:-1]
    errors = np.zeros_like(steps)
    errors[1:] = arrived[1:] - track.T_key_scan[:-1] - steps[1:]
    errors[:, 2] = wrap_angle(errors[:, 2])
    limits = config.outlier_sigmas * np.array([robust_deviation(axis) for axis in errors[follows].T])
    is_kept = np.zeros(len(firsts), dtype=np.bool_)
    is_kept[part_of[:-1][(np.abs(errors[1:]) > limits).any(axis=1)]] = True
    is_kept[[key - 1 for key in track.keys_without_odometry() if 0 < key <= len(firsts)]] = True
    smoothed = track.T_key_scan.copy()
    in_a_row = follows[1:][np.diff(follows) == 1]
    by_chance = math.sqrt(chi2_gate(2.0 * config.chance, freedom=1))
    for axis in range(3):
        usual = np.clip(errors[:, axis], -limits[axis], limits[axis])
        whole = dense.vecdot(usual[follows], usual[follows]) / len(follows)
        shared = -dense.vecdot(usual[in_a_row], usual[in_a_row - 1]) / max(1, len(in_a_row))
        measured = shared - by_chance * whole / math.sqrt(max(1, len(in_a_row)))
        if measured <= 0.0:
            continue
        kernels.smooth(
            np.ascontiguousarray(track.T_key_scan[:, axis]),
            np.ascontiguousarray(steps[:, axis]),
            np.append(firsts, len(steps)),
            np.ascontiguousarray(ends[:, axis]),
            is_kept,
            measured,
            max(whole - 2.0 * measured, _LEAST_MOVED * whole),
            column := smoothed[:, axis].copy(),
        )
        smoothed[:, axis] = column
    return replace(track, T_key_scan=smoothed)


def _steps(T_key_scan: Floats, odometry: Floats) -> Floats:
    """(n, 3) steps by odometry to every scan from the one before, in the frame of the key scan of that one."""
    c, s = cos_sin(T_key_scan[:-1, 2])
    moved = between(odometry[:-1], odometry[1:])
    steps = np.zeros_like(T_key_scan)
    steps[1:] = np.column_stack([c * moved[:, 0] - s * moved[:, 1], s * moved[:, 0] + c * moved[:, 1], moved[:, 2]])
    return steps
