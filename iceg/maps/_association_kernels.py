"""Compiled loops that tell which feature of a key scan is which landmark."""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled
from iceg.maps.landmark_arrays import INTERSECTION, Records, Settings

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]


@compiled
def _observation_noise(features: Records, settings: Settings) -> F64:
    """(n_features, 3) entries xx, xy, yy of each feature's covariance, the error of the key pose included.

    That error is a shift, and a turn that moves the feature across its line of sight.
    """
    noise = np.empty((len(features), 3))
    for f in range(len(features)):
        covariance = features[f].covariance
        x, y = features[f].position
        noise[f, 0] = covariance[0, 0] + settings.pose_variance + settings.heading_variance * y * y
        noise[f, 1] = covariance[0, 1] - settings.heading_variance * x * y
        noise[f, 2] = covariance[1, 1] + settings.pose_variance + settings.heading_variance * x * x
    return noise


@compiled
def _associate(
    features: Records, noise: F64, landmarks: Records, near: I64, near_p: F64, near_turn: F64, settings: Settings
) -> tuple[I64, Bool]:
    """Give each real feature at most one landmark and each landmark at most one feature, cheapest pairs first.

    Returns:
        For each feature its place in `near` or -1, and for each near landmark whether it is accounted for: it has a
        feature, or one without landmark lies close to it, a weak one, or one that failed a gate.
    """
    n_features, n_near = len(features), len(near)
    landmark_of = np.full(n_features, -1, np.int64)
    accounted = np.zeros(n_near, np.bool_)
    close_feature, close_near = _close_pairs(features, near_p, settings.max_distance)
    cost = _pair_costs(close_feature, close_near, features, noise, landmarks, near, near_p, near_turn, settings)
    for pair in _ascending(cost):
        f, j = close_feature[pair], close_near[pair]
        if landmark_of[f] < 0 and not accounted[j]:
            landmark_of[f] = j
            accounted[j] = True
    for pair in range(len(cost)):
        accounted[close_near[pair]] |= landmark_of[close_feature[pair]] < 0
    return landmark_of, accounted


@compiled
def _close_pairs(features: Records, near_p: F64, max_distance: float) -> tuple[I64, I64]:
    """All pairs of a feature and a near landmark within max_distance [m]."""
    n_features, n_near = len(features), len(near_p)
    pair_feature, pair_near = np.empty(n_features * n_near, np.int64), np.empty(n_features * n_near, np.int64)
    n_pairs = 0
    for j in range(n_near):
        for f in range(n_features):
            dx, dy = features[f].position[0] - near_p[j, 0], features[f].position[1] - near_p[j, 1]
            if dx * dx + dy * dy <= max_distance * max_distance:
                pair_feature[n_pairs], pair_near[n_pairs] = f, j
                n_pairs += 1
    return pair_feature[:n_pairs], pair_near[:n_pairs]


@compiled
def _ascending(values: F64) -> I64:
    """Where the finite ones of a few values stand, smallest first; equal ones keep their order."""
    order = np.empty(len(values), np.int64)
    n = 0
    for i in range(len(values)):
        if not np.isfinite(values[i]):
            continue
        at = n
        while at > 0 and values[order[at - 1]] > values[i]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = i
        n += 1
    return order[:n]


@compiled
def _pair_costs(
    close_feature: I64,
    close_near: I64,
    features: Records,
    noise: F64,
    landmarks: Records,
    near: I64,
    near_p: F64,
    near_turn: F64,
    settings: Settings,
) -> F64:
    """Squared normalised distance of each close pair in position and directions; infinite beyond a gate."""
    costs = np.full(len(close_feature), np.inf)
    for pair in range(len(costs)):
        f, j = close_feature[pair], close_near[pair]
        feature, landmark = features[f], landmarks[near[j]]
        if not feature.real or not _same_kind(feature.kind, landmark.kind):
            continue
        turn = np.arctan2(near_turn[j, 1], near_turn[j, 0])
        a0, a1 = feature.directions[0] - turn, feature.directions[1] - turn
        known, known_variances, covariance = landmark.directions, landmark.direction_variances, landmark.covariance
        w0, w1, d0, d1 = _pair_directions(feature.kind, a0, a1, known[0], known[1])
        if (w0 < 0 and w1 < 0) or abs(d0) > settings.max_angle or abs(d1) > settings.max_angle:
            continue
        dx, dy = feature.position[0] - near_p[j, 0], feature.position[1] - near_p[j, 1]
        pxx, pxy, pyy = _rotated(covariance[0, 0], covariance[0, 1], covariance[1, 1], near_turn[j, 0], near_turn[j, 1])
        sxx, sxy, syy = pxx + noise[f, 0], pxy + noise[f, 1], pyy + noise[f, 2]
        cost = (syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy) / (sxx * syy - sxy * sxy)
        if cost > settings.gate:
            continue
        variance = feature.direction_variance + settings.heading_variance
        if w0 >= 0:
            cost += d0 * d0 / (variance + known_variances[w0])
        if w1 >= 0:
            cost += d1 * d1 / (variance + known_variances[w1])
        costs[pair] = cost
    return costs


@compiled
def _rotated(xx: float, xy: float, yy: float, cos: float, sin: float) -> tuple[float, float, float]:
    """R C Rᵀ of a symmetric C, entries xx, xy, yy."""
    return (
        cos * cos * xx - 2.0 * cos * sin * xy + sin * sin * yy,
        cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy,
        sin * sin * xx + 2.0 * cos * sin * xy + cos * cos * yy,
    )


@compiled
def _wrap(angle: float) -> float:
    """The same angle in [-π, π)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@compiled
def _wrap_line(angle: float) -> float:
    """The same angle of a line without orientation in [-π/2, π/2)."""
    return (angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi


@compiled
def _same_kind(a: int, b: int) -> bool:
    """Whether two kinds may be one landmark: equal, or a corner whose second wall was hidden from the other."""
    return a == b or INTERSECTION not in (a, b)


@compiled
def _pair_directions(kind: int, a0: float, a1: float, b0: float, b1: float) -> tuple[int, int, float, float]:
    """How the walls of feature a and landmark b correspond: clockwise to clockwise, as one sees their open side.

    Returns:
        For each wall of a the wall of b it is (-1: none), and the difference a - b of each pair [rad] (0: none).
    """
    if kind == INTERSECTION:
        # Extensions of walls have neither orientation nor a side.
        straight0, straight1 = _wrap_line(a0 - b0), _wrap_line(a1 - b1)
        crossed0, crossed1 = _wrap_line(a0 - b1), _wrap_line(a1 - b0)
        if max(abs(straight0), abs(straight1)) <= max(abs(crossed0), abs(crossed1)):
            return 0, 1, straight0, straight1
        return 1, 0, crossed0, crossed1
    both0, both1 = not (np.isnan(a0) or np.isnan(b0)), not (np.isnan(a1) or np.isnan(b1))
    return (0 if both0 else -1, 1 if both1 else -1, _wrap(a0 - b0) if both0 else 0.0, _wrap(a1 - b1) if both1 else 0.0)
