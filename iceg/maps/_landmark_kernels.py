"""Compiled loop of the feature map: associate the features of one key scan, fuse them, judge what was not seen."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph.compiled import ZERO, compiled

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I8 = NDArray[np.int8]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

CORNER, END_OF_WALL, INTERSECTION = 0, 1, 2


class Store(NamedTuple):
    """The landmarks as growing arrays, each landmark in the frame of its anchor."""

    anchors: I64
    kinds: I8
    positions: F64
    directions: F64
    covariances: F64
    direction_variances: F64
    distances: F64
    existence: F64  # log-odds
    first_seen: I64
    last_seen: I64
    seen: I64
    missed: I64
    expired_at: I64


class Observed(NamedTuple):
    """The features of one key scan, robot frame, and the scan itself."""

    kinds: I8
    positions: F64
    directions: F64
    covariances: F64
    direction_variances: F64
    distances: F64
    real: Bool
    ranges: F32
    bearings: F64
    T_robot_laser: F64


class Settings(NamedTuple):
    """What the kernels need of the configuration: variances, and evidence in log-odds."""

    gate: float
    max_distance: float
    max_angle: float
    pose_variance: float
    heading_variance: float
    drift_variance: float
    landmark_range: float
    landmark_variance: float
    visible_range: float
    occlusion_margin: float
    sin_edge_on: float
    seen_evidence: float
    missed_evidence: float
    highest_evidence: float
    expiry_evidence: float


@compiled
def observe(
    first_key: int,
    ends: I64,
    frames: F64,
    features: Observed,
    ranges: F32,
    store: Store,
    valid: I64,
    n_valid: int,
    count: int,
    settings: Settings,
) -> tuple[int, int]:
    """Enter the features of key scans, one after the other.

    Args:
        first_key: index of the first scan's key pose; the others follow.
        ends: (n_scans,) where the features of each scan end among all.
        frames: (n_keys, 4) x, y [m], cosine and sine of the heading of each key pose in the map frame.
        features: of all scans; its ranges are not looked at.
        ranges: (n_scans, n_beams) of the scans.
        store: the landmarks, changed in place, with room for the features of all scans.
        valid: (≥ n_valid + n_features,) the landmarks that have not expired, ascending, changed in place.
        n_valid: how many these are.
        count: number of landmarks so far.
        settings: the configuration.

    Returns:
        The new number of landmarks, and of those that have not expired.
    """
    start = ZERO
    for scan in range(len(ends)):
        end = ends[scan]
        observed = Observed(
            features.kinds[start:end],
            features.positions[start:end],
            features.directions[start:end],
            features.covariances[start:end],
            features.direction_variances[start:end],
            features.distances[start:end],
            features.real[start:end],
            ranges[scan],
            features.bearings,
            features.T_robot_laser,
        )
        key = first_key + scan
        near, near_p, near_turn = nearby(key, frames, observed, store, valid[:n_valid], settings)
        noise = observation_noise(observed, settings)
        landmark_of, taken, explained = associate(observed, noise, store, near, near_p, near_turn, settings)
        fuse(key, observed, noise, store, near, near_p, near_turn, landmark_of, settings)
        judge(key, observed, store, near, near_p, near_turn, taken | explained, settings)
        more = add(key, observed, store, count, landmark_of, settings)
        n_valid = drop_expired(valid, n_valid, store.expired_at)
        for new in range(count, more):
            valid[n_valid] = new
            n_valid += 1
        count, start = more, end
    return count, n_valid


@compiled
def drop_expired(valid: I64, n_valid: int, expired_at: I64) -> int:
    """Close up over the landmarks that have expired: the cost depends on what is there, not on what ever was."""
    kept = ZERO
    for place in range(n_valid):
        if expired_at[valid[place]] < 0:
            valid[kept] = valid[place]
            kept += 1
    return kept


@compiled
def nearby(
    key: int, frames: F64, observed: Observed, store: Store, valid: I64, settings: Settings
) -> tuple[I64, F64, F64]:
    """Valid landmarks within reach of a key pose.

    Returns:
        Their numbers (k,), their positions in the robot frame (k, 2), and the cosine and sine of the rotation from the
        anchor to the robot frame (k, 2).
    """
    kx, ky, kc, ks = frames[key]
    reach = settings.visible_range
    for f in range(len(observed.kinds)):
        if observed.distances[f] <= settings.landmark_range:
            reach = max(reach, observed.distances[f] + settings.max_distance)
    reach += np.hypot(observed.T_robot_laser[0], observed.T_robot_laser[1])
    near = np.empty(len(valid), np.int64)
    near_p = np.empty((len(valid), 2))
    near_turn = np.empty((len(valid), 2))
    n = 0
    for k in valid:
        ax, ay, ac, a_s = frames[store.anchors[k]]
        px, py = store.positions[k, 0], store.positions[k, 1]
        mx, my = ax + ac * px - a_s * py - kx, ay + a_s * px + ac * py - ky
        if mx * mx + my * my > reach * reach:
            continue
        near[n] = k
        near_p[n, 0], near_p[n, 1] = kc * mx + ks * my, kc * my - ks * mx
        near_turn[n, 0], near_turn[n, 1] = kc * ac + ks * a_s, kc * a_s - ks * ac
        n += 1
    return near[:n], near_p[:n], near_turn[:n]


@compiled
def observation_noise(observed: Observed, settings: Settings) -> F64:
    """(n_features, 3) entries xx, xy, yy of each feature's covariance, the error of the key pose included.

    That error is a shift, and a turn that moves the feature across its line of sight.
    """
    noise = np.empty((len(observed.kinds), 3))
    for f in range(len(observed.kinds)):
        x, y = observed.positions[f, 0], observed.positions[f, 1]
        covariance = observed.covariances[f]
        noise[f, 0] = covariance[0, 0] + settings.pose_variance + settings.heading_variance * y * y
        noise[f, 1] = covariance[0, 1] - settings.heading_variance * x * y
        noise[f, 2] = covariance[1, 1] + settings.pose_variance + settings.heading_variance * x * x
    return noise


@compiled
def associate(
    observed: Observed, noise: F64, store: Store, near: I64, near_p: F64, near_turn: F64, settings: Settings
) -> tuple[I64, Bool, Bool]:
    """Give each real feature at most one landmark and each landmark at most one feature, cheapest pairs first.

    Returns:
        For each feature its place in `near` or -1, for each near landmark whether it has a feature, and whether a
        feature without landmark lies close to it: a weak one, or one that failed a gate.
    """
    n_features, n_near = len(observed.kinds), len(near)
    landmark_of = np.full(n_features, -1, np.int64)
    taken = np.zeros(n_near, np.bool_)
    close_feature, close_near = close_pairs(observed, near_p, settings.max_distance)
    cost = pair_costs(close_feature, close_near, observed, noise, store, near, near_p, near_turn, settings)
    for pair in ascending(cost):
        f, j = close_feature[pair], close_near[pair]
        if landmark_of[f] < 0 and not taken[j]:
            landmark_of[f] = j
            taken[j] = True
    explained = np.zeros(n_near, np.bool_)
    for pair in range(len(cost)):
        explained[close_near[pair]] |= landmark_of[close_feature[pair]] < 0
    return landmark_of, taken, explained


@compiled
def close_pairs(observed: Observed, near_p: F64, max_distance: float) -> tuple[I64, I64]:
    """All pairs of a feature and a near landmark within max_distance [m]."""
    order = ascending(observed.positions[:, 0].copy())
    xs = np.empty(len(order))
    for rank in range(len(order)):
        xs[rank] = observed.positions[order[rank], 0]
    pair_feature, pair_near = np.empty(256, np.int64), np.empty(256, np.int64)
    n_pairs = 0
    if len(order) == 0:
        return pair_feature[:0], pair_near[:0]
    lowest, highest = np.inf, -np.inf
    for rank in range(len(order)):
        y = observed.positions[order[rank], 1]
        lowest, highest = min(lowest, y), max(highest, y)
    for j in range(len(near_p)):
        x, y = near_p[j, 0], near_p[j, 1]
        outside = max(xs[0] - x, x - xs[len(xs) - 1], lowest - y, y - highest)
        if outside > 0.0 and outside * outside > max_distance * max_distance:
            continue  # as all that lies behind the robot
        for rank in range(np.searchsorted(xs, x - max_distance), len(xs)):
            dx = xs[rank] - x
            if dx > max_distance:
                break
            dy = observed.positions[order[rank], 1] - y
            if dx * dx + dy * dy > max_distance * max_distance:
                continue
            if n_pairs == len(pair_near):
                pair_feature, pair_near = twice_as_long(pair_feature), twice_as_long(pair_near)
            pair_feature[n_pairs], pair_near[n_pairs] = order[rank], j
            n_pairs += 1
    return pair_feature[:n_pairs], pair_near[:n_pairs]


@compiled
def ascending(values: F64) -> I64:
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
def twice_as_long(numbers: I64) -> I64:
    """A copy with room for as many more."""
    longer = np.empty(2 * len(numbers), np.int64)
    assign(longer[: len(numbers)], numbers)
    return longer


@compiled
def pair_costs(
    close_feature: I64,
    close_near: I64,
    observed: Observed,
    noise: F64,
    store: Store,
    near: I64,
    near_p: F64,
    near_turn: F64,
    settings: Settings,
) -> F64:
    """Squared normalised distance of each close pair in position and directions; infinite beyond a gate."""
    positions, directions, variances = observed.positions, observed.directions, observed.direction_variances
    covariances, known_directions = store.covariances, store.directions
    known_variances = store.direction_variances
    costs = np.full(len(close_feature), np.inf)
    for pair in range(len(costs)):
        f, j = close_feature[pair], close_near[pair]
        k = near[j]
        kind = observed.kinds[f]
        if not observed.real[f] or not same_kind(kind, store.kinds[k]):
            continue
        turn = np.arctan2(near_turn[j, 1], near_turn[j, 0])
        a0, a1 = directions[f, 0] - turn, directions[f, 1] - turn
        w0, w1, d0, d1 = pair_directions(kind, a0, a1, known_directions[k, 0], known_directions[k, 1])
        if (w0 < 0 and w1 < 0) or abs(d0) > settings.max_angle or abs(d1) > settings.max_angle:
            continue
        dx, dy = positions[f, 0] - near_p[j, 0], positions[f, 1] - near_p[j, 1]
        pxx, pxy, pyy = rotated(
            covariances[k, 0, 0], covariances[k, 0, 1], covariances[k, 1, 1], near_turn[j, 0], near_turn[j, 1]
        )
        sxx, sxy, syy = pxx + noise[f, 0], pxy + noise[f, 1], pyy + noise[f, 2]
        cost = (syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy) / (sxx * syy - sxy * sxy)
        if cost > settings.gate:
            continue
        variance = variances[f] + settings.heading_variance
        if w0 >= 0:
            cost += d0 * d0 / (variance + known_variances[k, w0])
        if w1 >= 0:
            cost += d1 * d1 / (variance + known_variances[k, w1])
        costs[pair] = cost
    return costs


@compiled
def fuse(
    key: int,
    observed: Observed,
    noise: F64,
    store: Store,
    near: I64,
    near_p: F64,
    near_turn: F64,
    landmark_of: I64,
    settings: Settings,
) -> None:
    """Correct every landmark that has a feature by it."""
    for f in range(len(landmark_of)):
        j = landmark_of[f]
        if j < 0:
            continue
        k = near[j]
        dx, dy = observed.positions[f, 0] - near_p[j, 0], observed.positions[f, 1] - near_p[j, 1]
        fuse_position(store.positions[k], store.covariances[k], noise[f], dx, dy, near_turn[j], settings.drift_variance)
        turn = np.arctan2(near_turn[j, 1], near_turn[j, 0])
        a0, a1 = observed.directions[f, 0] - turn, observed.directions[f, 1] - turn
        known, variances = store.directions[k], store.direction_variances[k]
        w0, w1, d0, d1 = pair_directions(observed.kinds[f], a0, a1, known[0], known[1])
        variance = observed.direction_variances[f] + settings.heading_variance
        if w0 >= 0:
            fuse_direction(known, variances, w0, d0, variance)
        if w1 >= 0:
            fuse_direction(known, variances, w1, d1, variance)
        if store.kinds[k] == END_OF_WALL and observed.kinds[f] == CORNER:
            # The second wall, hidden so far, has appeared.
            store.kinds[k] = CORNER
            hidden = 1 if w0 >= 0 else 0
            known[hidden] = wrap(a1 if w0 >= 0 else a0)
            variances[hidden] = variance
        store.distances[k] = min(store.distances[k], observed.distances[f])
        store.existence[k] = min(store.existence[k] + settings.seen_evidence, settings.highest_evidence)
        store.seen[k] += 1
        store.last_seen[k] = key


@compiled
def fuse_position(
    position: F64, covariance: F64, noise: F64, dx: float, dy: float, turn: F64, drift_variance: float
) -> None:
    """Kalman update of a landmark, in the frame of its anchor, by an observation (dx, dy) off it in the robot frame."""
    cos, sin = turn[0], turn[1]
    pxx, pxy, pyy = rotated(covariance[0, 0], covariance[0, 1], covariance[1, 1], cos, sin)
    pxx, pyy = pxx + drift_variance, pyy + drift_variance
    sxx, sxy, syy = pxx + noise[0], pxy + noise[1], pyy + noise[2]
    det = sxx * syy - sxy * sxy
    gxx, gxy = (pxx * syy - pxy * sxy) / det, (pxy * sxx - pxx * sxy) / det
    gyx, gyy = (pxy * syy - pyy * sxy) / det, (pyy * sxx - pxy * sxy) / det
    mx, my = gxx * dx + gxy * dy, gyx * dx + gyy * dy
    position[0] += cos * mx + sin * my
    position[1] += cos * my - sin * mx
    qxx = (1.0 - gxx) * pxx - gxy * pxy
    qxy = 0.5 * ((1.0 - gxx) * pxy - gxy * pyy + (1.0 - gyy) * pxy - gyx * pxx)
    qyy = (1.0 - gyy) * pyy - gyx * pxy
    qxx, qxy, qyy = rotated(qxx, qxy, qyy, cos, -sin)
    covariance[0, 0], covariance[0, 1], covariance[1, 0], covariance[1, 1] = qxx, qxy, qxy, qyy


@compiled
def fuse_direction(directions: F64, variances: F64, wall: int, difference: float, variance: float) -> None:
    """Move one direction of a landmark towards an observation that differs by `difference`."""
    gain = variances[wall] / (variances[wall] + variance)
    directions[wall] = wrap(directions[wall] + gain * difference)
    variances[wall] *= 1.0 - gain


@compiled
def judge(
    key: int,
    observed: Observed,
    store: Store,
    near: I64,
    near_p: F64,
    near_turn: F64,
    accounted: Bool,
    settings: Settings,
) -> None:
    """Count landmarks as missed that should be visible and are not accounted for, and expire them in the end.

    A weak feature close by, or one that failed a gate, neither confirms nor refutes a landmark.
    """
    laser = observed.T_robot_laser
    cos, sin = np.cos(laser[2]), np.sin(laser[2])
    reach = settings.visible_range
    bearings = observed.bearings
    first_x, first_y = np.cos(bearings[0]), np.sin(bearings[0])
    last_x, last_y = np.cos(bearings[-1]), np.sin(bearings[-1])
    is_wide = bearings[-1] - bearings[0] > np.pi
    for j in range(len(near)):
        k = near[j]
        x, y = near_p[j, 0] - laser[0], near_p[j, 1] - laser[1]
        if accounted[j] or x * x + y * y > reach * reach:
            continue
        x, y = cos * x + sin * y, cos * y - sin * x
        is_left, is_right = first_x * y - first_y * x >= 0.0, last_x * y - last_y * x <= 0.0
        if not (is_left or is_right if is_wide else is_left and is_right):
            continue  # beside the field of view, as half of what is near
        slack = 2.0 * np.sqrt(settings.pose_variance + max(store.covariances[k, 0, 0], store.covariances[k, 1, 1]))
        bearing = open_bearing(x, y, observed.ranges, bearings, reach, settings.occlusion_margin, slack)
        if np.isnan(bearing):
            continue
        to_laser = np.arctan2(near_turn[j, 1], near_turn[j, 0]) - laser[2]
        direction0, direction1 = store.directions[k, 0] + to_laser, store.directions[k, 1] + to_laser
        if is_broadside(direction0 - bearing, direction1 - bearing, settings.sin_edge_on):
            store.missed[k] += 1
            store.existence[k] += settings.missed_evidence
            if store.existence[k] < settings.expiry_evidence:
                store.expired_at[k] = key


@compiled
def add(key: int, observed: Observed, store: Store, count: int, landmark_of: I64, settings: Settings) -> int:
    """Make landmarks, anchored to the key pose, of the features that have none; returns the number of landmarks."""
    for f in range(len(landmark_of)):
        covariance = observed.covariances[f]
        if landmark_of[f] >= 0 or not observed.real[f] or observed.distances[f] > settings.landmark_range:
            continue
        if max(covariance[0, 0], covariance[1, 1]) > settings.landmark_variance:
            continue
        store.anchors[count] = key
        store.kinds[count] = observed.kinds[f]
        assign(store.positions[count], observed.positions[f])
        assign(store.directions[count], observed.directions[f])
        assign(store.covariances[count], covariance)
        for wall in range(2):
            known = not np.isnan(observed.directions[f, wall])
            store.direction_variances[count, wall] = observed.direction_variances[f] if known else np.nan
        store.distances[count] = observed.distances[f]
        store.existence[count] = 0.0
        store.first_seen[count] = store.last_seen[count] = key
        store.seen[count] = 1
        store.missed[count] = 0
        store.expired_at[count] = -1
        count += 1
    return count


@compiled
def rotated(xx: float, xy: float, yy: float, cos: float, sin: float) -> tuple[float, float, float]:
    """R C Rᵀ of a symmetric C, entries xx, xy, yy."""
    return (
        cos * cos * xx - 2.0 * cos * sin * xy + sin * sin * yy,
        cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy,
        sin * sin * xx + 2.0 * cos * sin * xy + cos * cos * yy,
    )


@compiled
def wrap(angle: float) -> float:
    """The same angle in [-π, π)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@compiled
def wrap_line(angle: float) -> float:
    """The same angle of a line without orientation in [-π/2, π/2)."""
    return (angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi


@compiled
def same_kind(a: int, b: int) -> bool:
    """Whether two kinds may be one landmark: equal, or a corner whose second wall was hidden from the other."""
    return a == b or INTERSECTION not in (a, b)


@compiled
def pair_directions(kind: int, a0: float, a1: float, b0: float, b1: float) -> tuple[int, int, float, float]:
    """How the walls of feature a and landmark b correspond: clockwise to clockwise, as one sees their open side.

    Returns:
        For each wall of a the wall of b it is (-1: none), and the difference a - b of each pair [rad] (0: none).
    """
    if kind == INTERSECTION:
        # Extensions of walls have neither orientation nor a side.
        straight0, straight1 = wrap_line(a0 - b0), wrap_line(a1 - b1)
        crossed0, crossed1 = wrap_line(a0 - b1), wrap_line(a1 - b0)
        if max(abs(straight0), abs(straight1)) <= max(abs(crossed0), abs(crossed1)):
            return 0, 1, straight0, straight1
        return 1, 0, crossed0, crossed1
    both0, both1 = not (np.isnan(a0) or np.isnan(b0)), not (np.isnan(a1) or np.isnan(b1))
    return (0 if both0 else -1, 1 if both1 else -1, wrap(a0 - b0) if both0 else 0.0, wrap(a1 - b1) if both1 else 0.0)


@compiled
def open_bearing(
    x: float,
    y: float,
    ranges: F32,
    bearings: F64,
    visible_range: float,
    occlusion_margin: float,
    position_slack: float,
) -> float:
    """Where a scan would have to show a landmark at (x, y) in the laser frame if it were there.

    It must lie within range and field of view, and no beam around its bearing may end before it. A beam without return
    says nothing.

    Returns:
        Its bearing [rad]; NaN if the scan need not show it.
    """
    distance = np.hypot(x, y)
    if distance > visible_range or distance < 1e-6:
        return np.nan
    bearing = np.arctan2(y, x)
    n = len(bearings)
    spacing = (bearings[n - 1] - bearings[0]) / (n - 1)
    # Bearings may run beyond ±π for a laser mounted or numbered that way.
    bearing = bearings[0] + (bearing - bearings[0]) % (2.0 * np.pi)
    window = max(1.5 * spacing, position_slack / distance)
    if bearing - window < bearings[0] or bearing + window > bearings[n - 1]:
        return np.nan
    first = np.searchsorted(bearings, bearing - window)
    end = np.searchsorted(bearings, bearing + window)
    returns = 0
    for i in range(first, end):
        if np.isnan(ranges[i]):
            continue
        if ranges[i] < distance - occlusion_margin:
            return np.nan
        returns += 1
    return bearing if 2 * returns > end - first else np.nan


@compiled
def is_broadside(direction0: float, direction1: float, sin_edge_on: float) -> bool:
    """Whether a wall of a landmark, its directions seen from the line of sight, is not seen edge-on."""
    broadside = 0.0
    if not np.isnan(direction0):
        broadside = abs(np.sin(direction0))
    if not np.isnan(direction1):
        broadside = max(broadside, abs(np.sin(direction1)))
    return bool(broadside >= sin_edge_on)
