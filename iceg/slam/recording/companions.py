"""People who go along with the robot: they stay beside it while everything else passes by.

A matcher that takes them for standing holds the robot back, and along a corridor they may be all that speaks for a
motion. At every 70 cm of path, each narrow object nearby is compared with those of the step before: one that
stands is seen where odometry foretells it, one that goes along is seen where it was. The steps are a sequential
likelihood ratio test (Wald 1945), begun anew whenever standing is the likelier (Page 1954, CUSUM).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from frontends.scan import Log, ScanGeometry
from graph.arrays import Bools, Float32s, Floats, Ints
from graph.elementary import cos_sin
from graph.se2 import between, compose, transform_points
from iceg.slam.companion_config import CompanionConfig


@dataclass(frozen=True, slots=True)
class _Objects:
    """Narrow objects nearby that stand free, in the order of scans and beams.

    Attributes:
        scan: (m,) row of the scan that sees each.
        first: (m,) its first beam …
        last: (m,) … and its last, beyond the number of beams where it lies across the seam of a full circle.
        centre: (m, 2) in the laser's frame [m].
    """

    scan: Ints
    first: Ints
    last: Ints
    centre: Floats


def without_companions(log: Log, config: CompanionConfig) -> Log:
    """The same log; where somebody goes along with the robot, with nothing seen of them and a warning."""
    if not (config.enabled and log.has_odometry and len(log) > 1):
        return log
    ways = [*_ways(log, config)]
    if not ways:
        return log
    ranges, n_beams = log.ranges.copy(), log.geometry.n_beams
    gone = np.zeros(len(log), dtype=np.bool_)
    for scans, places in ways:
        rows = np.arange(scans[0], scans[-1] + 1)
        objects = _objects(log.ranges[rows], log.geometry, config)
        there = np.stack([np.interp(rows, scans, places[:, axis]) for axis in (0, 1)], axis=1)
        off = objects.centre - there[objects.scan]
        for k in np.flatnonzero((off * off).sum(axis=1) < config.zone**2).tolist():
            ranges[rows[objects.scan[k]], np.arange(objects.first[k], objects.last[k] + 1) % n_beams] = np.nan
        gone[rows] = True
    warning = (
        f"somebody goes along with the robot in {np.count_nonzero(gone)} scans, first at scan {int(np.argmax(gone))}: "
        "what the laser sees of them is left out"
    )
    return replace(log, ranges=ranges, warnings=(*log.warnings, warning))


def _ways(log: Log, config: CompanionConfig) -> Iterator[tuple[Ints, Floats]]:
    """Where each who goes along is: (k,) scans, and (k, 2) places in the laser's frame at these."""
    asked = _every_step(log.odometry, config.step)
    objects = _objects(log.ranges[asked], log.geometry, config)
    T_odom_laser = compose(log.odometry[asked], log.geometry.T_robot_laser)
    score, before = _scores(objects, between(T_odom_laser[1:], T_odom_laser[:-1]), config)
    is_known = np.zeros(len(score), dtype=np.bool_)
    for newest in np.flatnonzero(score >= -math.log(config.false_alarm))[::-1].tolist():
        way, at = [], newest
        while at >= 0 and not is_known[at]:
            is_known[at] = True
            way.append(at)
            at = int(before[at])
        if len(way) > 1:
            yield asked[objects.scan[way[::-1]]], objects.centre[way[::-1]]


def _every_step(odometry: Floats, step: float) -> Ints:
    """(k,) the first scan, and each by which another step of path has been made [m]."""
    moves = np.diff(odometry[:, :2], axis=0)
    path = np.concatenate([[0.0], np.cumsum(np.sqrt((moves * moves).sum(axis=1)))])
    return np.asarray(np.unique((path / step).astype(np.int64), return_index=True)[1], dtype=np.int64)


def _scores(objects: _Objects, T_now_before: Floats, config: CompanionConfig) -> tuple[Floats, Ints]:
    """How much more probable it is of each object that it goes along than that it stands.

    Args:
        objects: of k scans.
        T_now_before: (k - 1, 3) the laser at each scan but the last, in the frame of the one after.
        config: how probable what is at a step.

    Returns:
        (m,) logarithm of the likelihood ratio, no less than 0; (m,) which object of the scan before each was, -1 where
        the test begins.
    """
    told = math.log(config.unexplained / config.hidden)
    doubted = math.log((1.0 - config.unexplained) / (1.0 - config.hidden))
    score, before = np.zeros(len(objects.scan)), np.full(len(objects.scan), -1, dtype=np.int64)
    starts = np.searchsorted(objects.scan, np.arange(len(T_now_before) + 2)).tolist()
    for k, step in enumerate(T_now_before):
        start, middle, end = starts[k : k + 3]
        if middle in (start, end):
            continue
        was, now = objects.centre[start:middle], objects.centre[middle:end]
        foretold = transform_points(step, was)
        from_was, from_foretold = _distances2(was, now), _distances2(foretold, now)
        nearest = from_was.argmin(axis=0)
        stands = from_foretold < config.stands**2
        has_stopped: Bools = np.asarray(stands.any(axis=1))
        is_explained = stands.any(axis=0) | has_stopped[nearest]
        moved2 = ((foretold - was) ** 2).sum(axis=1)[nearest]
        tells = (from_was.min(axis=0) < config.stays**2) & (moved2 > (config.min_step * config.step) ** 2)
        ratio = np.maximum(score[start:middle][nearest] + np.where(is_explained, doubted, told), 0.0)
        score[middle:end] = np.where(tells, ratio, 0.0)
        before[middle:end] = np.where(score[middle:end] > 0.0, start + nearest, -1)
    return score, before


def _distances2(a: Floats, b: Floats) -> Floats:
    """(n, m) squares of the distances between (n, 2) and (m, 2) points."""
    x, y = (a[:, None, axis] - b[None, :, axis] for axis in (0, 1))
    return np.asarray(x * x + y * y)


def _objects(ranges: Float32s, geometry: ScanGeometry, config: CompanionConfig) -> _Objects:
    """The narrow objects nearby in (n, n_beams) scans beside which all that is seen is farther away.

    A laser that sees all around has no first beam: what lies across the seam is seen by its last beams and its first.
    """
    n_beams = geometry.n_beams
    beams = np.arange(n_beams + (n_beams // 4 if geometry.is_full_circle else 0)) % n_beams
    far = np.where(np.isfinite(ranges), ranges, np.inf)[:, beams]
    right = np.concatenate([far[:, n_beams - 1 : n_beams], far[:, :-1]], axis=1)
    left = np.concatenate([far[:, 1:], np.full((len(far), 1), np.inf, dtype=far.dtype)], axis=1)
    if not geometry.is_full_circle:
        right[:, 0] = np.inf
    is_near = far < config.reach
    with np.errstate(invalid="ignore"):
        begins = is_near & ~((right < config.reach) & (np.abs(far - right) <= config.gap))
        ends = is_near & ~((left < config.reach) & (np.abs(far - left) <= config.gap))
        is_free_right, is_free_left = right > far + config.gap, left > far + config.gap
    if geometry.is_full_circle:
        begins[:, 0] |= is_near[:, 0]  # of which the other half is found at the seam
    first, last = np.flatnonzero(begins), np.flatnonzero(ends)
    is_free = is_free_right.ravel()[first] & is_free_left.ravel()[last]
    c, s = cos_sin(geometry.bearings[beams])
    within = np.where(is_near, far, 0.0)
    x, y = (within * c).ravel(), (within * s).ravel()
    is_narrow = (x[first] - x[last]) ** 2 + (y[first] - y[last]) ** 2 < config.width**2
    scan, column = np.divmod(first, len(beams))
    chosen = is_free & is_narrow & (column < n_beams) & (last - first >= config.min_returns - 1)
    first, last = first[chosen], last[chosen]
    n_points = last - first + 1
    sums = [np.concatenate([[0.0], np.cumsum(values)]) for values in (x, y)]
    centre = np.stack([(total[last + 1] - total[first]) / n_points for total in sums], axis=1)
    return _Objects(scan[chosen], column[chosen], column[chosen] + n_points - 1, centre)
