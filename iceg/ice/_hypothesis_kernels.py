"""Compiled loops that pair features, and judge the relative poses these pairs imply."""

from math import atan, cos, exp, floor, hypot, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph._dense_kernels import _solve_one
from graph.compiled import compiled

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I8 = NDArray[np.int8]
I64 = NDArray[np.int64]

_CORNER = 0
_SAME_DIRECTION = 0.3
"""Directions of paired features differ by no more than this after the turn of the hypothesis [rad]."""
_SAME_ANGLE = 0.35
"""The same for features that coincide [rad]."""
_POSITION_FLOOR = 4e-4
"""Added to the variances of two features that are compared: of their positions [m²] …"""
_ANGLE_FLOOR = 1e-3
"""… and of their directions [rad²]."""
_PROMISING = 0.15
"""A hypothesis is scored on all points if its score on few comes this near to the best."""
# A window of ±π leaves out no heading, however π is rounded.
_ROUNDING = 1e-9
_DIAGONAL = sqrt(2.0)
_TOGETHER = 32
"""Features whose places are compared at once."""


@compiled
def _wrap(angle: float) -> float:
    return angle - 2.0 * pi * floor((angle + pi) / (2.0 * pi))


@compiled
def _compatible(kind: int, other: int) -> bool:
    """The same kind, or a corner one of whose walls (or the corner itself) was hidden."""
    return kind == other or min(kind, other) == _CORNER


@compiled
def _turned_covariance(row: F64, c: float, s: float) -> tuple[float, float, float]:
    """Covariance xx, xy, yy of a feature's position, turned."""
    xx, xy, yy = row[4], row[5], row[6]
    return (
        c * c * xx - 2.0 * c * s * xy + s * s * yy,
        c * s * (xx - yy) + (c * c - s * s) * xy,
        s * s * xx + 2.0 * c * s * xy + c * c * yy,
    )


@compiled
def _same_directions(row: F64, turn: float, other: F64) -> bool:
    """Whether both have the same walls, and these point the same way."""
    for column in range(2, 4):
        if np.isnan(row[column]) != np.isnan(other[column]):
            return False
        if not np.isnan(row[column]) and abs(_wrap(row[column] + turn - other[column])) > _SAME_DIRECTION:
            return False
    return True


@compiled
def merge_features(
    kinds: I8, rows: F64, starts: I64, poses: F64, radius: float, map_kinds: I8, map_rows: F64, hits: F64, m: int
) -> int:
    """Move the features of scans into the map frame and merge each with an equal one within a radius.

    Args:
        kinds: (n,) of the new features.
        rows: (n, 10), see `iceg.ice.features.FeatureRows`.
        starts: (k + 1,) scan i has the features from starts[i] to starts[i + 1].
        poses: (k, 3) T_map_robot of each scan.
        radius: within this two features of one kind and direction are one [m].
        map_kinds: (capacity,) changed in place.
        map_rows: (capacity, 10) changed in place; position and direction are running means.
        hits: (capacity,) how often each was seen.
        m: features of the map so far.

    Returns:
        Its new number of features.
    """
    xs, ys = np.empty(len(map_kinds)), np.empty(len(map_kinds))
    for k in range(m):
        xs[k], ys[k] = map_rows[k, 0], map_rows[k, 1]
    for scan in range(len(poses)):
        heading = poses[scan, 2]
        c, s = cos(heading), sin(heading)
        for i in range(starts[scan], starts[scan + 1]):
            row = rows[i]
            x = poses[scan, 0] + c * row[0] - s * row[1]
            y = poses[scan, 1] + s * row[0] + c * row[1]
            found = _equal_feature(kinds[i], row, x, y, heading, radius, map_kinds, map_rows, xs[:m], ys[:m])
            if found >= 0:
                _merge_into(map_rows[found], row, x, y, heading, hits[found])
                hits[found] += 1.0
                xs[found], ys[found] = map_rows[found, 0], map_rows[found, 1]
            elif m < len(map_kinds):
                map_kinds[m] = kinds[i]
                assign(map_rows[m], row)
                map_rows[m, 0], map_rows[m, 1] = x, y
                map_rows[m, 2], map_rows[m, 3] = row[2] + heading, row[3] + heading
                map_rows[m, 4], map_rows[m, 5], map_rows[m, 6] = _turned_covariance(row, c, s)
                hits[m] = 1.0
                xs[m], ys[m] = x, y
                m += 1
    return m


@compiled
def _equal_feature(
    kind: int, row: F64, x: float, y: float, turn: float, radius: float, map_kinds: I8, map_rows: F64, xs: F64, ys: F64
) -> int:
    """The first feature of the map, at xs and ys, that may be a feature moved to x, y; -1 if none."""
    for first in range(0, len(xs), _TOGETHER):
        # Several at once and without branches, for hardly any is near.
        near = 0
        some_x, some_y = xs[first : first + _TOGETHER], ys[first : first + _TOGETHER]
        for k in range(some_x.size):
            near += (abs(some_x[k] - x) <= radius) & (abs(some_y[k] - y) <= radius)
        if near == 0:
            continue
        for k in range(first, first + some_x.size):
            if map_kinds[k] != kind or abs(xs[k] - x) > radius or abs(ys[k] - y) > radius:
                continue
            if _same_directions(row, turn, map_rows[k]):
                return k
    return -1


@compiled
def _merge_into(other: F64, row: F64, x: float, y: float, turn: float, hits: float) -> None:
    """Average a feature moved to x, y into one of the map that was seen so many times."""
    w = 1.0 / (hits + 1.0)
    other[0] += w * (x - other[0])
    other[1] += w * (y - other[1])
    for column in range(2, 4):
        if not np.isnan(row[column]):
            other[column] += w * _wrap(row[column] + turn - other[column])
    other[8] = max(other[8], row[8])
    other[9] = min(other[9], row[9])


@compiled
def _turn_between(a0: float, a1: float, opening: float) -> float:
    """Turn that brings the walls of a feature onto those of another, from the turns of its two walls.

    NaN where they share no wall or open differently.
    """
    if np.isnan(a0):
        return a1
    if np.isnan(a1):
        return a0
    difference = _wrap(a1 - a0)
    return a0 + 0.5 * difference if abs(difference) <= opening else np.nan


@compiled
def pair_hypotheses(
    kinds: I8,
    rows: F64,
    ref_kinds: I8,
    ref_rows: F64,
    guess: F64,
    window_m: float,
    window_rad: float,
    opening: float,
    out: F64,
) -> int:
    """One relative pose for every pair of features that passes the hierarchy of filters.

    Args:
        kinds: (n,) of the new features.
        rows: (n, 10).
        ref_kinds: (m,) of the reference.
        ref_rows: (m, 10).
        guess: (3,) T_ref_robot at the middle of the feasible area.
        window_m: its half-width in x and y [m].
        window_rad: its half-width in heading [rad].
        opening: largest difference of the opening angles of a pair [rad].
        out: (capacity, 3) output.

    Returns:
        The number of hypotheses.
    """
    count = 0
    ref_distances = np.empty(len(ref_kinds))
    for j in range(len(ref_kinds)):
        ref_distances[j] = hypot(ref_rows[j, 0] - guess[0], ref_rows[j, 1] - guess[1])
    farthest = _DIAGONAL * window_m + _ROUNDING
    for i in range(len(kinds)):
        x, y = rows[i, 0], rows[i, 1]
        distance = hypot(x, y)
        for j in range(len(ref_kinds)):
            # However the robot is turned, it is at least as far from the guess as these two distances differ.
            if abs(ref_distances[j] - distance) > farthest or not _compatible(kinds[i], ref_kinds[j]):
                continue
            turn = _turn_between(ref_rows[j, 2] - rows[i, 2], ref_rows[j, 3] - rows[i, 3], opening)
            if np.isnan(turn) or abs(_wrap(turn - guess[2])) > window_rad + _ROUNDING:
                continue
            c, s = cos(turn), sin(turn)
            tx = ref_rows[j, 0] - c * x + s * y
            ty = ref_rows[j, 1] - s * x - c * y
            if abs(tx - guess[0]) > window_m or abs(ty - guess[1]) > window_m:
                continue
            if count == len(out):
                return count
            out[count, 0], out[count, 1], out[count, 2] = tx, ty, _wrap(turn)
            count += 1
    return count


@compiled
def distinct(hypotheses: F64, order: I64, separation_m: float, separation_rad: float, chosen: I64) -> int:
    """The first hypotheses in an order that differ from all chosen before.

    Args:
        hypotheses: (h, 3) T_ref_robot.
        order: (n,) indices of hypotheses, the best first.
        separation_m: nearer than this [m] …
        separation_rad: … and turned by less than this [rad] two hypotheses are the same.
        chosen: (wanted,) output: their indices.

    Returns:
        How many there are, at most as many as wanted.
    """
    count = 0
    for index in order:
        if count == len(chosen):
            break
        differs = True
        for k in range(count):
            other = chosen[k]
            dx, dy = hypotheses[index, 0] - hypotheses[other, 0], hypotheses[index, 1] - hypotheses[other, 1]
            turn = abs(_wrap(hypotheses[index, 2] - hypotheses[other, 2]))
            if dx * dx + dy * dy < separation_m * separation_m and turn < separation_rad:
                differs = False
                break
        if differs:
            chosen[count] = index
            count += 1
    return count


@compiled
def _picked(points: F64, n: int) -> tuple[F64, F64]:
    """Evenly picked points: x and y, (n,) each."""
    x, y = np.empty(n), np.empty(n)
    stride = len(points) / n
    for q in range(n):
        i = int((q + 0.5) * stride)
        x[q], y[q] = points[i, 0], points[i, 1]
    return x, y


@compiled
def _likelihood(px: F64, py: F64, pose: F64, cells: F32, nx: int, x0: float, y0: float, cell: float) -> float:
    """Mean of the likelihoods of points, (n,) each, in cells of nx columns; of those outside it is 0."""
    width, height, columns = float(nx), float(len(cells) // nx), np.int32(nx)
    c, s = cos(pose[2]) / cell, sin(pose[2]) / cell
    x, y = (pose[0] - x0) / cell, (pose[1] - y0) / cell
    total = 0.0
    for q in range(len(px)):
        # Without branches: whether the next point is near anything cannot be foretold.
        u, v = x + c * px[q] - s * py[q], y + s * px[q] + c * py[q]
        inside = (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height)
        at = np.int32(v if inside else 0.0) * columns + np.int32(u if inside else 0.0)
        total += float(cells[at]) if inside else 0.0
    return total / len(px)


@compiled
def score_by_points(
    points: F64, n_first: int, n_picks: int, hypotheses: F64, likelihood: F32, origin: F64, cell: float, scores: F64
) -> None:
    """Mean likelihood of the points of a scan where hypotheses put them.

    Few points judge all hypotheses first; only the promising ones are judged by more. The others keep their first
    score, but never one above the worst of the promising.

    Args:
        points: (n, 2) in the robot frame [m].
        n_first: points of the first round.
        n_picks: points of the second round; the first is skipped when it has as many.
        hypotheses: (h, 3) T_ref_robot.
        likelihood: (ny, nx) field.
        origin: (2,) its lower left corner [m].
        cell: width of its cells [m].
        scores: (h,) output.
    """
    x0, y0, nx, cells = origin[0], origin[1], likelihood.shape[1], likelihood.reshape(-1)
    enough = -np.inf
    if n_first < n_picks:
        px, py = _picked(points, n_first)
        for h in range(len(hypotheses)):
            scores[h] = _likelihood(px, py, hypotheses[h], cells, nx, x0, y0, cell)
            enough = max(enough, scores[h] - _PROMISING)
    lowest = np.inf
    px, py = _picked(points, n_picks)
    for h in range(len(hypotheses)):
        if n_first >= n_picks or scores[h] >= enough:
            # Marked by 2 so that the last loop tells them from the others.
            scores[h] = 2.0 + _likelihood(px, py, hypotheses[h], cells, nx, x0, y0, cell)
            lowest = min(lowest, scores[h] - 2.0)
    for h in range(len(hypotheses)):
        scores[h] = scores[h] - 2.0 if scores[h] >= 2.0 else min(scores[h], lowest)


@compiled
def _coincidence(
    kind: int, row: F64, x: float, y: float, turn: float, ref_kinds: I8, ref_rows: F64
) -> tuple[int, float, float]:
    """Nearest reference feature that a feature moved to x, y may be: index or -1, squared distance, angle."""
    gate = row[9] / 50.0 + 0.1
    best, best_d2, best_angle = -1, gate * gate, 0.0
    for j in range(len(ref_kinds)):
        dx, dy = ref_rows[j, 0] - x, ref_rows[j, 1] - y
        d2 = dx * dx + dy * dy
        if d2 > best_d2 or not _compatible(kind, ref_kinds[j]):
            continue
        angle = -1.0
        for column in range(2, 4):
            a = ref_rows[j, column] - row[column] - turn
            if not np.isnan(a):
                angle = max(angle, abs(_wrap(a)))
        if angle < 0.0 or angle > _SAME_ANGLE:
            continue
        best, best_d2, best_angle = j, d2, angle
    return best, best_d2, best_angle


@compiled
def _importance(distance: float) -> float:
    """Equation (3): what a feature at this distance from the laser is worth."""
    return max(0.0, 0.6 - 0.4 * atan(0.2 * distance - 0.2))


@compiled
def _information(row: F64, c: float, s: float, ref: F64) -> tuple[float, float, float]:
    """Inverse xx, xy, yy of the covariance of the difference of two features' positions."""
    xx, xy, yy = _turned_covariance(row, c, s)
    xx += ref[4] + _POSITION_FLOOR
    xy += ref[5]
    yy += ref[6] + _POSITION_FLOOR
    det = xx * yy - xy * xy
    return yy / det, -xy / det, xx / det


@compiled
def score_by_features(
    kinds: I8, rows: F64, ref_kinds: I8, ref_rows: F64, hypotheses: F64, paper: bool, counts: I64, scores: F64
) -> None:
    """Number of coincidences of each hypothesis and its correlation, larger is better, in [0, 1].

    Args:
        kinds: (n,) of the new features.
        rows: (n, 10).
        ref_kinds: (m,) of the reference.
        ref_rows: (m, 10).
        hypotheses: (h, 3) T_ref_robot.
        paper: equations (1) and (2) as exp(-Σ(dis·P)/(count²·ΣP)), dis a distance plus an angle. Otherwise the mean
            over the new features of exp(-½ Mahalanobis²) under the covariances of both features.
        counts: (h,) output.
        scores: (h,) output.
    """
    for h in range(len(hypotheses)):
        turn = hypotheses[h, 2]
        c, s = cos(turn), sin(turn)
        hit, weighted, weights, likelihood = 0, 0.0, 0.0, 0.0
        for i in range(len(kinds)):
            row = rows[i]
            x = hypotheses[h, 0] + c * row[0] - s * row[1]
            y = hypotheses[h, 1] + s * row[0] + c * row[1]
            j, d2, angle = _coincidence(kinds[i], row, x, y, turn, ref_kinds, ref_rows)
            if j < 0:
                continue
            hit += 1
            ref = ref_rows[j]
            if paper:
                p = sqrt(_importance(row[9]) * _importance(ref[9]))
                weighted += (sqrt(d2) + angle) * p
                weights += p
            else:
                ixx, ixy, iyy = _information(row, c, s, ref)
                dx, dy = ref[0] - x, ref[1] - y
                far = ixx * dx * dx + 2.0 * ixy * dx * dy + iyy * dy * dy
                far += angle * angle / (row[7] + ref[7] + _ANGLE_FLOOR)
                likelihood += exp(-0.5 * far)
        counts[h] = hit
        if paper:
            scores[h] = exp(-weighted / (hit * hit * weights)) if weights > 0.0 else 0.0
        else:
            scores[h] = likelihood / max(1, len(kinds))


@compiled
def polish_on_features(
    kinds: I8, rows: F64, ref_kinds: I8, ref_rows: F64, start: F64, iterations: int, pose: F64
) -> int:
    """Gauss-Newton on coinciding features, each weighed by the covariances of both.

    Args:
        kinds: (n,) of the new features.
        rows: (n, 10).
        ref_kinds: (m,) of the reference.
        ref_rows: (m, 10).
        start: (3,) T_ref_robot.
        iterations: most steps.
        pose: (3,) output.

    Returns:
        The number of coincidences.
    """
    assign(pose, start)
    h, g, step = np.empty((3, 3)), np.empty(3), np.empty(3)
    hit = 0
    for _ in range(iterations):
        hit = _accumulate_features(kinds, rows, ref_kinds, ref_rows, pose, h, g)
        if hit == 0:
            break
        if not _solve_one(h, g, step):
            break
        pose -= step
        if hypot(step[0], step[1]) < 1e-4 and abs(step[2]) < 1e-5:
            break
    return hit


@compiled
def _accumulate_features(kinds: I8, rows: F64, ref_kinds: I8, ref_rows: F64, pose: F64, h: F64, g: F64) -> int:
    """Normal equations of the coinciding features, with Cauchy weights; return how many coincide."""
    c, s = cos(pose[2]), sin(pose[2])
    h[:] = 0.0
    h[0, 0], h[1, 1], h[2, 2] = 1e-6, 1e-6, 1e-6
    g[:] = 0.0
    hit = 0
    for i in range(len(kinds)):
        row = rows[i]
        rx, ry = c * row[0] - s * row[1], s * row[0] + c * row[1]
        x, y = pose[0] + rx, pose[1] + ry
        j, _, _ = _coincidence(kinds[i], row, x, y, pose[2], ref_kinds, ref_rows)
        if j < 0:
            continue
        hit += 1
        ref = ref_rows[j]
        ixx, ixy, iyy = _information(row, c, s, ref)
        ex, ey = x - ref[0], y - ref[1]
        w = 1.0 / (1.0 + 0.25 * (ixx * ex * ex + 2.0 * ixy * ex * ey + iyy * ey * ey))
        fx, fy = w * (ixx * ex + ixy * ey), w * (ixy * ex + iyy * ey)
        # Derivative of the position with respect to the heading: (-ry, rx).
        h[0, 0] += w * ixx
        h[0, 1] += w * ixy
        h[1, 1] += w * iyy
        h[0, 2] += w * (ixy * rx - ixx * ry)
        h[1, 2] += w * (iyy * rx - ixy * ry)
        h[2, 2] += w * (ixx * ry * ry - 2.0 * ixy * rx * ry + iyy * rx * rx)
        g[0] += fx
        g[1] += fy
        g[2] += rx * fy - ry * fx
        for column in range(2, 4):
            a = ref[column] - row[column] - pose[2]
            if not np.isnan(a):
                precision = w / (row[7] + ref[7] + _ANGLE_FLOOR)
                h[2, 2] += precision
                g[2] -= precision * _wrap(a)
    h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
    return hit
