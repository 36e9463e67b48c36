"""Whether matches are as sure as they say, asked of the log itself: two halves of one scan must agree.

The covariance of a match is calibrated on simulated scans, whose errors are those of a good laser. Recorded ones err
in ways that no residual tells, for the match moves with them: ranges that come in steps, so that neighbouring beams of
one wall share an error; walls that are no lines; a matcher whose weights do not suit the noise. But they differ from
one half of the view to the other. So some scans are matched twice more, the beams to the right and those to the left
each alone, to the same local map: how far the two poses lie apart, against what their covariances allow (split-half
reliability, as psychologists call it), needs no truth and misses little.
"""

import math
from dataclasses import replace
from typing import TypeGuard

import numpy as np

from frontends.matcher import Matcher
from frontends.scan import Scan
from graph.arrays import Floats
from graph.elementary import log
from graph.measurement import NoMatch, RelativePose
from graph.noise import squared_norm
from graph.se2 import between, logmap
from iceg.slam.map_matcher import NEAR
from iceg.slam.track import Track
from iceg.slam.tracking_config import SplitHalfConfig


def with_measured_covariance_scale(track: Track, matcher: Matcher, config: SplitHalfConfig) -> Track:
    """The same track, the variances of its matches as much larger as the log's own scans ask for.

    Args:
        track: what the front end found.
        matcher: that matched it.
        config: how many scans are split.

    Returns:
        The track with its `match_covariance_scale`.
    """
    scale = match_covariance_scale(split_half_distances(track, matcher, config), config)
    if scale == 1.0:
        return track
    keys = [
        key
        if isinstance(key.match, NoMatch)
        else replace(key, match=replace(key.match, covariance=scale * key.match.covariance))
        for key in track.keys
    ]
    return replace(track, keys=keys, match_covariance_scale=scale * track.match_covariance_scale)


def match_covariance_scale(distances2: Floats, config: SplitHalfConfig) -> float:
    """By how much the variances of matches are too small.

    Args:
        distances2: (n,) squared Mahalanobis distances between halves.
        config: what is usual.

    Returns:
        The ratio of their geometric mean to what is usual, as far as it is certain by a standard error; at least 1.
    """
    if len(distances2) < 2:
        return 1.0
    logs = log(np.maximum(distances2, config.min_distance2) / config.usual_distance2)
    return math.exp(max(0.0, float(logs.mean() - logs.std(ddof=1) / np.sqrt(len(logs)))))


def split_half_distances(track: Track, matcher: Matcher, config: SplitHalfConfig) -> Floats:
    """Squared Mahalanobis distances between the poses of the two halves of some key scans.

    Args:
        track: with the key scans.
        matcher: finds the halves.
        config: how many key scans are tried at most, evenly spread.

    Returns:
        (n,) of those both of whose halves know every direction.
    """
    able = [key for key in range(config.window, len(track.keys)) if track.keys[key].is_fully_observed]
    chosen = np.unique(np.linspace(0, len(able) - 1, min(config.scans, len(able))).round().astype(int)).tolist()
    found = (_distance2(track, matcher, able[k], config.window) for k in chosen)
    return np.array([distance2 for distance2 in found if distance2 is not None])


def halves(scan: Scan) -> tuple[Scan, Scan]:
    """The same scan without the later half of its returns, and without the earlier."""
    returns = np.flatnonzero(np.isfinite(scan.ranges))
    middle = returns[len(returns) // 2] if len(returns) else 0
    first, last = scan.ranges.copy(), scan.ranges.copy()
    first[middle:] = np.nan
    last[:middle] = np.nan
    return replace(scan, ranges=first), replace(scan, ranges=last)


def _distance2(track: Track, matcher: Matcher, key: int, window: int) -> float | None:
    """How far the halves of one key scan lie apart, matched to the key scans before it."""
    before = track.keys[key - window : key]
    T_track_before = np.array([one.T_track_robot for one in before])
    T_ref_before = between(T_track_before[-1], T_track_before)
    guess = between(T_track_before[-1], track.keys[key].T_track_robot)
    reference = matcher.prepare([one.scan for one in before], T_ref_before)
    one_half, other_half = halves(track.keys[key].scan)
    first = matcher.match(reference, one_half, guess, NEAR)
    if not _is_telling(first):
        return None
    last = matcher.match(reference, other_half, guess, NEAR)
    if not _is_telling(last):
        return None
    apart = logmap(between(first.T_ref_cur, last.T_ref_cur))
    return squared_norm(apart, first.covariance + last.covariance)


def _is_telling(match: RelativePose | NoMatch) -> TypeGuard[RelativePose]:
    return isinstance(match, RelativePose) and match.is_fully_observed
