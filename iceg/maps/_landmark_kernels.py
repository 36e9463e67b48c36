"""Compiled loop of the feature map: enter the features of key scans, fuse them, judge what was not seen."""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import ZERO, compiled, compiled_aside
from iceg.maps._association_kernels import _associate, _observation_noise, _pair_directions, _rotated, _wrap
from iceg.maps.landmark_arrays import CORNER, END_OF_WALL, Observed, Records, Settings

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]


@compiled_aside
def observe(
    first_key: int,
    ends: I64,
    frames: F64,
    seen: Observed,
    ranges: F32,
    landmarks: Records,
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
        seen: the features of all scans; its ranges are not looked at.
        ranges: (n_scans, n_beams) of the scans.
        landmarks: `LANDMARK` each, changed in place, with room for the features of all scans.
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
        observed = Observed(seen.features[start:end], ranges[scan], seen.bearings, seen.T_robot_laser)
        key = first_key + scan
        near, near_p, near_turn = _nearby(key, frames, observed, landmarks, valid[:n_valid], settings)
        features = observed.features
        noise = _observation_noise(features, settings)
        landmark_of, accounted = _associate(features, noise, landmarks, near, near_p, near_turn, settings)
        _fuse(key, features, noise, landmarks, near, near_p, near_turn, landmark_of, settings)
        _judge(key, observed, landmarks, near, near_p, near_turn, accounted, settings)
        more = _add(key, features, landmarks, count, landmark_of, settings)
        n_valid = _drop_expired(valid, n_valid, landmarks)
        for new in range(count, more):
            valid[n_valid] = new
            n_valid += 1
        count, start = more, end
    return count, n_valid


@compiled
def _drop_expired(valid: I64, n_valid: int, landmarks: Records) -> int:
    """Close up over the landmarks that have expired: the cost depends on what is there, not on what ever was."""
    kept = ZERO
    for place in range(n_valid):
        if landmarks[valid[place]].expired_at < 0:
            valid[kept] = valid[place]
            kept += 1
    return kept


@compiled
def _nearby(
    key: int, frames: F64, observed: Observed, landmarks: Records, valid: I64, settings: Settings
) -> tuple[I64, F64, F64]:
    """Valid landmarks within reach of a key pose.

    Returns:
        Their numbers (k,), their positions in the robot frame (k, 2), and the cosine and sine of the rotation from the
        anchor to the robot frame (k, 2).
    """
    kx, ky, kc, ks = frames[key]
    reach = settings.visible_range
    for f in range(len(observed.features)):
        distance = observed.features[f].distance
        if distance <= settings.landmark_range:
            reach = max(reach, distance + settings.max_distance)
    reach += np.hypot(observed.T_robot_laser[0], observed.T_robot_laser[1])
    near = np.empty(len(valid), np.int64)
    near_p = np.empty((len(valid), 2))
    near_turn = np.empty((len(valid), 2))
    n = 0
    for k in valid:
        ax, ay, ac, a_s = frames[landmarks[k].anchor]
        px, py = landmarks[k].position
        mx, my = ax + ac * px - a_s * py - kx, ay + a_s * px + ac * py - ky
        if mx * mx + my * my > reach * reach:
            continue
        near[n] = k
        near_p[n, 0], near_p[n, 1] = kc * mx + ks * my, kc * my - ks * mx
        near_turn[n, 0], near_turn[n, 1] = kc * ac + ks * a_s, kc * a_s - ks * ac
        n += 1
    return near[:n], near_p[:n], near_turn[:n]


@compiled
def _fuse(
    key: int,
    features: Records,
    noise: F64,
    landmarks: Records,
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
        feature, landmark = features[f], landmarks[near[j]]
        dx, dy = feature.position[0] - near_p[j, 0], feature.position[1] - near_p[j, 1]
        _fuse_position(landmark.position, landmark.covariance, noise[f], dx, dy, near_turn[j], settings.drift_variance)
        turn = np.arctan2(near_turn[j, 1], near_turn[j, 0])
        a0, a1 = feature.directions[0] - turn, feature.directions[1] - turn
        known, variances = landmark.directions, landmark.direction_variances
        w0, w1, d0, d1 = _pair_directions(feature.kind, a0, a1, known[0], known[1])
        variance = feature.direction_variance + settings.heading_variance
        if w0 >= 0:
            _fuse_direction(known, variances, w0, d0, variance)
        if w1 >= 0:
            _fuse_direction(known, variances, w1, d1, variance)
        if landmark.kind == END_OF_WALL and feature.kind == CORNER:
            # The second wall, hidden so far, has appeared.
            landmark.kind = CORNER
            hidden = 1 if w0 >= 0 else 0
            known[hidden] = _wrap(a1 if w0 >= 0 else a0)
            variances[hidden] = variance
        landmark.distance = min(landmark.distance, feature.distance)
        landmark.existence = min(landmark.existence + settings.seen_evidence, settings.highest_evidence)
        landmark.seen += 1
        landmark.last_seen = key


@compiled
def _fuse_position(
    position: F64, covariance: F64, noise: F64, dx: float, dy: float, turn: F64, drift_variance: float
) -> None:
    """Kalman update of a landmark, in the frame of its anchor, by an observation (dx, dy) off it in the robot frame."""
    cos, sin = turn[0], turn[1]
    pxx, pxy, pyy = _rotated(covariance[0, 0], covariance[0, 1], covariance[1, 1], cos, sin)
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
    qxx, qxy, qyy = _rotated(qxx, qxy, qyy, cos, -sin)
    covariance[0, 0], covariance[0, 1], covariance[1, 0], covariance[1, 1] = qxx, qxy, qxy, qyy


@compiled
def _fuse_direction(directions: F64, variances: F64, wall: int, difference: float, variance: float) -> None:
    """Move one direction of a landmark towards an observation that differs by `difference`."""
    gain = variances[wall] / (variances[wall] + variance)
    directions[wall] = _wrap(directions[wall] + gain * difference)
    variances[wall] *= 1.0 - gain


@compiled
def _judge(
    key: int,
    observed: Observed,
    landmarks: Records,
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
        landmark = landmarks[near[j]]
        x, y = near_p[j, 0] - laser[0], near_p[j, 1] - laser[1]
        if accounted[j] or x * x + y * y > reach * reach:
            continue
        x, y = cos * x + sin * y, cos * y - sin * x
        is_left, is_right = first_x * y - first_y * x >= 0.0, last_x * y - last_y * x <= 0.0
        if not (is_left or is_right if is_wide else is_left and is_right):
            continue  # beside the field of view, as half of what is near
        slack = 2.0 * np.sqrt(settings.pose_variance + max(landmark.covariance[0, 0], landmark.covariance[1, 1]))
        bearing = _open_bearing(x, y, observed.ranges, bearings, reach, settings.occlusion_margin, slack)
        if np.isnan(bearing):
            continue
        to_laser = np.arctan2(near_turn[j, 1], near_turn[j, 0]) - laser[2]
        direction0, direction1 = landmark.directions[0] + to_laser, landmark.directions[1] + to_laser
        if _is_broadside(direction0 - bearing, direction1 - bearing, settings.sin_edge_on):
            landmark.missed += 1
            landmark.existence += settings.missed_evidence
            if landmark.existence < settings.expiry_evidence:
                landmark.expired_at = key


@compiled
def _add(key: int, features: Records, landmarks: Records, count: int, landmark_of: I64, settings: Settings) -> int:
    """Make landmarks, anchored to the key pose, of the features that have none; returns the number of landmarks."""
    for f in range(len(landmark_of)):
        feature = features[f]
        if landmark_of[f] >= 0 or not feature.real or feature.distance > settings.landmark_range:
            continue
        if max(feature.covariance[0, 0], feature.covariance[1, 1]) > settings.landmark_variance:
            continue
        landmark = landmarks[count]
        landmark.anchor = key
        landmark.kind = feature.kind
        for a in range(2):
            landmark.position[a] = feature.position[a]
            landmark.directions[a] = feature.directions[a]
            known = not np.isnan(feature.directions[a])
            landmark.direction_variances[a] = feature.direction_variance if known else np.nan
            for b in range(2):
                landmark.covariance[a, b] = feature.covariance[a, b]
        landmark.distance = feature.distance
        landmark.existence = 0.0
        landmark.first_seen = landmark.last_seen = key
        landmark.seen = 1
        landmark.missed = 0
        landmark.expired_at = -1
        count += 1
    return count


@compiled
def _open_bearing(
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
    first, end = _first_from(bearings, bearing - window), _first_from(bearings, bearing + window)
    returns = 0
    for i in range(first, end):
        if np.isnan(ranges[i]):
            continue
        if ranges[i] < distance - occlusion_margin:
            return np.nan
        returns += 1
    return bearing if 2 * returns > end - first else np.nan


@compiled
def _first_from(ascending: F64, value: float) -> int:
    """Where the first of ascending numbers stands that is not below a value."""
    low, high = ZERO, len(ascending)
    while low < high:
        middle = (low + high) // 2
        if ascending[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@compiled
def _is_broadside(direction0: float, direction1: float, sin_edge_on: float) -> bool:
    """Whether a wall of a landmark, its directions seen from the line of sight, is not seen edge-on."""
    broadside = 0.0
    if not np.isnan(direction0):
        broadside = abs(np.sin(direction0))
    if not np.isnan(direction1):
        broadside = max(broadside, abs(np.sin(direction1)))
    return bool(broadside >= sin_edge_on)
