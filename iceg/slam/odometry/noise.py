"""How much odometry errs from one key scan to the next, as the matches of the log tell it.

What a match and odometry differ by is of three kinds, told apart by how it goes on. The match's own error ends with its
key scan: the next difference has it with the other sign. The error of odometry adds up. And the error of its heading
carries the robot aside: the model makes that of it by itself, so that only what the heading does not explain is noise
of the position. Matches among people, or along a corridor, err the same way for a while, so that nothing cancels; but
they say that they are less sure than others, and are believed as far as they differ more from odometry than those. A
few differences far beyond all others are slips, which are dealt with where a match contradicts odometry, and not by a
variance that holds for all.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from graph import dense
from graph.arrays import Floats, Ints
from graph.elementary import arctan2, cos_sin
from graph.odometry import OdometryModel
from graph.se2 import between
from iceg.slam.calibration_config import CalibrationConfig

_FIT_ROUNDS = 10
"""Rounds in which the weights follow the fitted variances."""
_LEVEL = 1e-9
"""A sum of squares that falls by no more than this, relative to what it would without any fit, is at its least."""
_NOTHING = 1e-300
"""Stands for the variance of errors that are all zero: nothing of them persists."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Differences:
    """Matches minus calibrated odometry, from one key scan to the next.

    Attributes:
        errors: (n, 3) in the tangent space at the end of each motion.
        claimed: (n, 3) variances the matches claim.
        turns: (n,) change of heading [rad].
        starts: (n,) scan at which each motion starts …
        ends: … and at which it ends.
    """

    errors: Floats
    claimed: Floats
    turns: Floats
    starts: Ints
    ends: Ints


def odometry_noise(
    moves: Differences, turns: Differences, odometry: Floats, config: CalibrationConfig
) -> tuple[OdometryModel, Floats]:
    """Fit the noise of odometry.

    Args:
        moves: differences between odometry and the matches that see all directions …
        turns: … and those that know the turn.
        odometry: (n_scans, 3).
        config: what is an outlier, a floor, persistence.

    Returns:
        The noise of single motions, and (3,) by how much the variance of a chain of them exceeds the sum of theirs, in
        x, y and heading, because errors persist.
    """
    paths = _Paths.of(moves.starts, moves.ends, odometry)
    turned_paths = _Paths.of(turns.starts, turns.ends, odometry)
    errors, claimed = moves.errors, moves.claimed
    persistence = np.empty(3)
    heading, persistence[2] = _heading_fit(turns.errors[:, 2], turns.claimed[:, 2], turned_paths, config)
    lever, left = paths.carried_by(heading)
    own = errors[:, :2] - lever * errors[:, 2:]
    rows = [paths.rows_x, paths.rows_y]
    known, following = np.empty_like(own), _turned(own[1:], moves.turns[1:])
    for k in range(2):
        by_match, persistence[k] = _shares(own[:, k], following[:, k], claimed[:, k], config)
        known[:, k] = by_match + left[:, k]
        known[:, k] += _unsure(own[:, k], known[:, k], claimed[:, k], rows[k], config)
    position = _variance_fit(list(own.T), list(known.T), rows, config, n_floors=2)
    variances = {
        "along_floor": max(position[0], _least_floor(paths.rows_x, position, config)),
        "across_floor": max(position[1], _least_floor(paths.rows_y, position, config)),
        "along_per_metre": position[2],
        "across_per_metre": position[3],
        "position_per_radian": position[4],
    }
    return OdometryModel(
        **_deviations(variances, config.least_noise), **_heading_deviations(turned_paths, heading, config)
    ), persistence


def heading_noise(
    errors: Floats, claimed: Floats, starts: Ints, ends: Ints, odometry: Floats, config: CalibrationConfig
) -> tuple[dict[str, float], float]:
    """Fit the noise of the heading alone.

    Args:
        errors: (n,) turns by matches minus those of odometry [rad].
        claimed: (n,) variances the matches claim [rad²].
        starts: (n,) scan at which each turn starts …
        ends: … and at which it ends.
        odometry: (n_scans, 3).
        config: what is an outlier, a floor, persistence.

    Returns:
        The standard deviations of the heading under their names in `OdometryModel`, and the persistence of its errors.
    """
    paths = _Paths.of(starts, ends, odometry)
    heading, persistence = _heading_fit(errors, claimed, paths, config)
    return _heading_deviations(paths, heading, config), persistence


def _heading_fit(errors: Floats, claimed: Floats, paths: "_Paths", config: CalibrationConfig) -> tuple[Floats, float]:
    """(3,) variances of the heading: floor, per metre, per radian; and the persistence of its errors."""
    by_match, persistence = _shares(errors, errors[1:], claimed, config)
    by_match += _unsure(errors, by_match, claimed, paths.rows_heading, config)
    return _variance_fit([errors], [by_match], [paths.rows_heading], config, n_floors=1), persistence


def _heading_deviations(paths: "_Paths", heading: Floats, config: CalibrationConfig) -> dict[str, float]:
    return _deviations(
        {
            "heading_floor": max(heading[0], _least_floor(paths.rows_heading, heading, config)),
            "heading_per_metre": heading[1],
            "heading_per_radian": heading[2],
        },
        config.least_noise,
    )


def _least_floor(rows: Floats, fit: Floats, config: CalibrationConfig) -> float:
    """Least variance that a motion of no length is believed to have."""
    return config.min_floor**2 * float(np.median(dense.matvec(rows, fit)))


def _deviations(variances: dict[str, float], least: OdometryModel) -> dict[str, float]:
    return {name: max(getattr(least, name), math.sqrt(variance)) for name, variance in variances.items()}


def lasting_noise(
    noise: OdometryModel, persistence: Floats, *, along: float = 0.0, drift: float = 0.0, turn: float = 0.0
) -> OdometryModel:
    """Noise for a graph, which takes the errors of successive motions for independent.

    Each axis is widened by its persistence. A scale error s is off by (sl)² after l metres: in the mean over all ways
    within a path of L metres as much as independent errors of ½ s²L a metre. So is a heading that drifts, and a scale
    of turns over the radians turned through.

    Args:
        noise: of single motions.
        persistence: (3,) factors on the variances in x, y and heading.
        along: what else the calibration leaves, the same all the way: s√L, s the standard deviation of the scale of
            the translation, L the longest way alone [m/√m];
        drift: of the drift of the heading [rad/√m];
        turn: of the scale of turns [rad/√rad].
    """
    x, y, heading = np.sqrt(persistence).tolist()
    return replace(
        noise,
        along_per_metre=math.hypot(x * noise.along_per_metre, math.sqrt(0.5) * along),
        across_per_metre=y * noise.across_per_metre,
        position_per_radian=max(x, y) * noise.position_per_radian,
        heading_per_metre=math.hypot(heading * noise.heading_per_metre, math.sqrt(0.5) * drift),
        heading_per_radian=math.hypot(heading * noise.heading_per_radian, math.sqrt(0.5) * turn),
        along_floor=x * noise.along_floor,
        across_floor=y * noise.across_floor,
        heading_floor=heading * noise.heading_floor,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Paths:
    """What the variances of motions are made of.

    Attributes:
        rows_x: (n, 5) what the coefficients of the position's noise are multiplied by in the variance of x at the end
            of each motion: floors ahead and aside, along and across per metre, position per radian.
        rows_y: (n, 5) the same of y.
        rows_heading: (n, 3) the same of the heading: floor, per metre, per radian.
        motion_of: (m,) motion of each step between scans.
        distance: (m,) length of the steps [m].
        turn: (m,) |change of heading| [rad].
        levers: (m, 2) what an error of the heading after the step moves the end of the motion by [m/rad].
        whole: (n, 2) what one before the first does.
    """

    rows_x: Floats
    rows_y: Floats
    rows_heading: Floats
    motion_of: Ints
    distance: Floats
    turn: Floats
    levers: Floats
    whole: Floats

    @classmethod
    def of(cls, starts: Ints, ends: Ints, odometry: Floats) -> "_Paths":
        n, lengths = len(starts), ends - starts
        motion_of = np.repeat(np.arange(n), lengths)
        scan = np.arange(len(motion_of)) + np.repeat(ends - np.cumsum(lengths), lengths)
        T_end_scan = between(odometry[ends[motion_of]], odometry[scan + 1])
        T_end_start = between(odometry[ends], odometry[starts])
        step = between(odometry[scan], odometry[scan + 1])
        distance, turn = np.hypot(step[:, 0], step[:, 1]), np.abs(step[:, 2])
        cos, sin = cos_sin(arctan2(step[:, 1], step[:, 0]) + T_end_scan[:, 2] - step[:, 2])
        in_line = np.bincount(motion_of, distance * cos**2, n)
        aside = np.bincount(motion_of, distance * sin**2, n)
        turned = np.bincount(motion_of, turn, n)
        straight = cos_sin(T_end_start[:, 2])[0] ** 2
        return cls(
            rows_x=np.column_stack([straight, 1.0 - straight, in_line, aside, turned]),
            rows_y=np.column_stack([1.0 - straight, straight, aside, in_line, turned]),
            rows_heading=np.column_stack([np.ones(n), in_line + aside, turned]),
            motion_of=motion_of,
            distance=distance,
            turn=turn,
            levers=_lever(T_end_scan),
            whole=_lever(T_end_start),
        )

    def carried_by(self, heading: Floats) -> tuple[Floats, Floats]:
        """What noise of the heading, its (3,) coefficients, does to the position at the end of each motion.

        Returns:
            (n, 2) most probable error in x and y per error of the heading; (n, 2) variance that is left beside it.
        """
        noise = heading[1] * self.distance + heading[2] * self.turn
        total = dense.matvec(self.rows_heading, heading) + 1e-12
        mean, left = np.empty_like(self.whole), np.empty_like(self.whole)
        for k in range(2):
            of_steps = np.bincount(self.motion_of, noise * self.levers[:, k], len(total))
            of_steps2 = np.bincount(self.motion_of, noise * self.levers[:, k] ** 2, len(total))
            mean[:, k] = (heading[0] * self.whole[:, k] + of_steps) / total
            left[:, k] = heading[0] * self.whole[:, k] ** 2 + of_steps2 - total * mean[:, k] ** 2
        return mean, np.maximum(left, 0.0)


def _lever(T_end_pose: Floats) -> Floats:
    """(n, 2) what turning at a pose moves the end by, seen from the end [m/rad]."""
    return np.column_stack([T_end_pose[:, 1], -T_end_pose[:, 0]])


def _turned(vectors: Floats, angles: Floats) -> Floats:
    c, s = cos_sin(angles)
    return np.column_stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]])


def _shares(errors: Floats, following: Floats, claimed: Floats, config: CalibrationConfig) -> tuple[Floats, float]:
    """What of differences is the matches', and how much that of odometry persists.

    Neighbours share the error of the match between them, with opposite signs. By how much a chain exceeds the sum of
    its motions is the sum of the autocovariances under Bartlett's window (Newey and West 1987), in which the error of
    matches cancels; it counts where it is beyond chance.

    Args:
        errors: (n,) differences.
        following: (n - 1,) the next one in the axes of each.
        claimed: (n,) variances of the matches.
        config: what is an outlier, how much is the matches' and how much persists at most.

    Returns:
        (n,) variances that are the matches', and the factor on the variance of odometry's own.
    """
    usual = robust_deviation(errors) ** 2
    certain = usual / (usual + claimed)  # how much of a difference is not the uncertainty of its match
    limit = config.outlier_sigmas * robust_deviation(errors * certain)
    e, after = np.clip(errors * certain, -limit, limit), np.clip(following * certain[1:], -limit, limit)
    last = min(config.persistence_lags, len(e) - 1)
    lags = [dense.vecdot(e[lag:], e[: len(e) - lag]) / len(e) for lag in range(last + 1)]
    cancelling = max(0.5 * (lags[2] + lags[3]), 0.0) - dense.vecdot(e[:-1], after) / len(e)
    claim = max(float(np.mean(certain**2 * claimed)), 1e-12)
    share = min(max(2.0 * cancelling / claim, 0.0), config.max_claimed)
    chain = lags[0] + 2.0 * sum((1.0 - lag / (last + 1.0)) * lags[lag] for lag in range(1, last + 1))
    persistence = chain / max(lags[0] - share * claim, 0.5 * lags[0], _NOTHING)
    chance = 2.0 * math.sqrt(4.0 * last / (3.0 * len(e)))  # two relative standard deviations of the sum
    is_clear = persistence * (1.0 - chance) > 1.0
    return share * claimed, min(persistence, config.max_persistence) if is_clear else 1.0


def _unsure(errors: Floats, known: Floats, claimed: Floats, rows: Floats, config: CalibrationConfig) -> Floats:
    """What else is the matches', whether it cancels or not: by how much differences grow with what these claim.

    Args:
        errors: (n,) differences.
        known: (n,) variance of them that is known.
        claimed: (n,) variances of the matches.
        rows: (n, m) what the coefficients of odometry's noise are multiplied by, which may grow alike.
        config: what is an outlier.

    Returns:
        (n,) variances, no more than claimed.
    """
    unsure, usual = claimed - claimed.min(), np.full(len(errors), robust_deviation(errors) ** 2)
    fit = _reweighted(errors**2, known, np.column_stack([rows, unsure]), usual, config.outlier_sigmas)
    return np.asarray(min(float(fit[-1]), 1.0) * unsure)


def robust_deviation(residual: Floats) -> float:
    """Standard deviation of most of (n,) residuals: that of a normal distribution with the same median deviation."""
    return 1.4826 * float(np.median(np.abs(residual))) + 1e-6


def _variance_fit(
    errors: Sequence[Floats],
    known: Sequence[Floats],
    rows: Sequence[Floats],
    config: CalibrationConfig,
    *,
    n_floors: int,
) -> Floats:
    """Coefficients ≥ 0 of what squared errors exceed a known variance by; several axes together.

    The first columns are floors: what a motion is off by however short it is. They are 0 unless they clearly explain
    more: key scans lie about as far apart as each other, and what grows with the path would look like it.
    """
    usual = np.concatenate([np.full(len(error), robust_deviation(error) ** 2) for error in errors])
    squared, sure, columns = np.concatenate(errors) ** 2, np.concatenate(known), np.concatenate(rows)
    growing = np.append(
        np.zeros(n_floors), _reweighted(squared, sure, columns[:, n_floors:], usual, config.outlier_sigmas)
    )
    whole = _reweighted(squared, sure, columns, usual, config.outlier_sigmas)
    expected = _expected(dense.matvec(columns, whole), sure)
    excess = np.minimum(squared, config.outlier_sigmas**2 * expected) - sure
    left, left_by_growing = (
        float(np.sum(((excess - dense.matvec(columns, fit)) / expected) ** 2)) for fit in (whole, growing)
    )
    return whole if (left_by_growing - left) * len(squared) > n_floors * config.floor_gain * left else growing


def _reweighted(squared: Floats, known: Floats, rows: Floats, usual: Floats, outlier: float) -> Floats:
    """Iteratively reweighted least squares: the larger a square is expected to be, the more it scatters."""
    expected, fit = usual + known, np.zeros(rows.shape[1])
    for _ in range(_FIT_ROUNDS):
        excess = np.minimum(squared, outlier**2 * expected) - known
        fit = _non_negative_fit(rows / expected[:, None], excess / expected)
        expected = _expected(dense.matvec(rows, fit), known)
    return fit


def _expected(fitted: Floats, known: Floats) -> Floats:
    return np.asarray(np.maximum(fitted, 1e-10) + known, dtype=np.float64)


def _non_negative_fit(rows: Floats, values: Floats) -> Floats:
    """Least squares with coefficients ≥ 0.

    Columns leave, that with the most negative coefficient first, until none is negative. That is the best fit if none
    of the columns left out would take part with a positive one; else it is looked for among all sets of columns.
    """
    n = rows.shape[1]
    square, right = dense.matmul(rows.T, rows), dense.matvec(rows.T, values)
    columns, fit = list(range(n)), np.zeros(n)
    while columns:
        fit = _fit_on(columns, square, right)
        if (fit >= 0.0).all():
            break
        columns.remove(int(fit.argmin()))
    if not columns:
        fit = np.zeros(n)
    slopes = right - dense.matvec(square, fit)
    return fit if (slopes <= _LEVEL * np.abs(right)).all() else _best_of_all_sets(square, right)


def _fit_on(columns: list[int], square: Floats, right: Floats) -> Floats:
    """(n,) what solves the normal equations on some of the columns, 0 elsewhere."""
    fit = np.zeros(len(right))
    fit[columns] = dense.least_norm_solution(square[np.ix_(columns, columns)], right[columns])
    return fit


def _best_of_all_sets(square: Floats, right: Floats) -> Floats:
    """The best of the fits on some of the columns without negative coefficients; for a few of these."""
    n = len(right)
    best, least = np.zeros(n), 0.0
    for size in range(1, n + 1):
        for columns in map(list, combinations(range(n), size)):
            fit = _fit_on(columns, square, right)
            gain = -dense.vecdot(fit, right)  # of the sum of squares, against no fit at all
            if gain < least and (fit >= 0.0).all():
                best, least = fit, gain
    return best
