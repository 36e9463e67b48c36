"""Scans between two key scans, smoothed: matches say where each of them is, odometry how one leads to the next.

The match of a single scan errs by a millimetre or two, each in its own way, and odometry errs as little from scan to
scan; along a corridor, or among people, matches err by decimetres, and odometry still as little. Key scans are tied to
each other by the graph and to the walls, and stay where they are.
"""

import math
from dataclasses import replace
from sys import float_info

import numpy as np

from graph import dense
from graph.arrays import Floats
from graph.elementary import cos_sin, exp, log
from graph.measurement import NoMatch
from graph.noise import chi2_gate
from graph.se2 import adjoint, between, wrap_angle
from iceg.slam.odometry.noise import robust_deviation
from iceg.slam.track import Track
from iceg.slam.tracking import _smoothing_kernels as kernels
from iceg.slam.tracking_config import SmoothingConfig

_LEAST_SHARE = 1e-2
"""Neither odometry nor a usual match errs by less than this share of what steps and matches differ by, squared."""
_ROUNDS = 20
"""Most reweightings of a part."""


def smoothed_between_keys(track: Track, odometry: Floats, config: SmoothingConfig) -> Track:
    """The track with the most probable poses of the scans between key scans.

    How much a match usually errs the log tells: two steps in a row share the error of the match between them, with
    opposite signs, so that minus their covariance is its variance, as far as that is negative beyond chance. The rest
    is odometry's. How much more or less those of one part err their key scans tell, by what their matches claim. Each
    axis is taken by itself, in the frame of the key scan. Either may be an outlier, where wheels slip or somebody walks
    by: both are distributed by Student's t.

    Args:
        track: of a log with odometry.
        odometry: (n_scans, 3) calibrated.
        config: how heavy the tails of either are, and what is chance.

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
    is_kept = np.zeros(len(firsts), dtype=np.bool_)
    is_kept[[key - 1 for key in track.keys_without_odometry() if 0 < key <= len(firsts)]] = True
    in_a_row = follows[1:][np.diff(follows) == 1]
    by_chance = math.sqrt(chi2_gate(2.0 * config.chance, freedom=1))
    claimed = _claimed(track)
    measured, moved = claimed / np.median(claimed, axis=0), np.zeros(3)
    for axis in range(3):
        limit = config.outlier_sigmas * robust_deviation(errors[follows, axis])
        usual = np.clip(errors[:, axis], -limit, limit)
        whole = dense.vecdot(usual[follows], usual[follows]) / len(follows)
        shared = -dense.vecdot(usual[in_a_row], usual[in_a_row - 1]) / max(1, len(in_a_row))
        proven = max(0.0, shared - by_chance * whole / math.sqrt(max(1, len(in_a_row))))
        measured[:, axis] *= max(proven, _LEAST_SHARE * whole, float_info.epsilon)
        moved[axis] = max(whole - 2.0 * proven, _LEAST_SHARE * whole, float_info.epsilon)
    smoothed = track.T_key_scan.copy()
    kernels.smooth(
        track.T_key_scan,
        np.append(steps, np.zeros((1, 3)), axis=0),
        np.append(firsts, len(steps)),
        ends,
        is_kept,
        measured,
        moved,
        config.freedom,
        _ROUNDS,
        smoothed,
    )
    return replace(track, T_key_scan=smoothed)


def _claimed(track: Track) -> Floats:
    """(n_scans, 3) variances of matches as key scans claim them, in the frame of the key scan of each.

    Between what the match of a key scan claims and that of the next its logarithm is interpolated. A key scan that
    matched nothing is known as well as odometry knows the way to it, but for the first: that is as well as the second.
    """
    claimed = np.array(
        [key.motion.covariance if isinstance(key.match, NoMatch) else key.match.covariance for key in track.keys]
    )
    claimed[0] = claimed[min(1, len(claimed) - 1)]
    firsts, part_of, T_track_keys = track.key_scans, track.key_of_scan, track.T_track_keys
    following = np.append(claimed[1:], claimed[-1:], axis=0)
    turned = np.zeros_like(T_track_keys)
    turned[:-1, 2] = between(T_track_keys[:-1], T_track_keys[1:])[:, 2]
    following = dense.congruence(adjoint(turned), following)
    at_start, at_end = (log(np.diagonal(of_keys, axis1=1, axis2=2)) for of_keys in (claimed, following))
    passed = (np.arange(len(part_of)) - firsts[part_of]) / np.diff(np.append(firsts, len(part_of)))[part_of]
    return exp(at_start[part_of] + passed[:, None] * (at_end - at_start)[part_of])


def _steps(T_key_scan: Floats, odometry: Floats) -> Floats:
    """(n, 3) steps by odometry to every scan from the one before, in the frame of the key scan of that one."""
    c, s = cos_sin(T_key_scan[:-1, 2])
    moved = between(odometry[:-1], odometry[1:])
    steps = np.zeros_like(T_key_scan)
    steps[1:] = np.column_stack([c * moved[:, 0] - s * moved[:, 1], s * moved[:, 0] + c * moved[:, 1], moved[:, 2]])
    return steps
