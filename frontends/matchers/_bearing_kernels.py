"""Compiled iterations of the matchers that keep the points of both scans in bearing order: ICP, PLICP, IDC, MbICP.

A closest point is searched outwards from the bearing of the query: a point δ further round is at least r·sin δ away,
which ends the search exactly, after a handful of candidates. Every matching kernel returns

- the pose of the scan in the frame of the reference,
- H and M, (3, 3): Hessian of its least squares and scatter of its gradient for a small motion (x, y, θ) in the frame
  and about the origin of the reference, so that the covariance is H⁻¹ M H⁻¹,
- (pairs, mean square residual [m²], iterations).
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_COARSE = 100.0
"""The iterations have settled, and stricter trimming begins, at steps this many times longer than at the end."""
_Result = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


@njit(cache=True)
def icp(
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    max_distance: float,
    trim: float,
    final_trim: float,
    iterations: int,
    epsilon: float,
) -> _Result:
    """Closest points, the best `trim` of them, their rigid fit; again until nothing moves."""
    pose = start.copy()
    moved, targets, squares, kept, indices = _buffers(len(points))
    no_links = np.zeros(len(xy), np.bool_)
    settled, done = False, 0
    for _ in range(iterations):
        done += 1
        _move(points, pose, moved)
        _associate(xy, bearings, no_links, moved, math.inf, math.pi, max_distance, targets, squares, indices)
        if _trim(squares, final_trim if settled else trim, kept) < 3:
            break
        fit = _rigid_fit(points, targets, kept)
        if _take(fit, pose, epsilon if settled else _COARSE * epsilon):
            if settled:
                break
            settled = True
    return _closing(points, pose, moved, targets, kept, math.inf, done)


@njit(cache=True)
def idc(
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    linked: NDArray[np.bool_],
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    window: float,
    decay: float,
    min_window: float,
    max_distance: float,
    trim: float,
    final_trim: float,
    iterations: int,
    epsilon: float,
) -> _Result:
    """Translation from the closest points, rotation from the points at matching range, in a window that narrows."""
    pose = start.copy()
    moved, targets, squares, kept, indices = _buffers(len(points))
    _, same_range, range_squares, range_kept, _ = _buffers(len(points))
    ranges = np.sqrt(xy[:, 0] ** 2 + xy[:, 1] ** 2)
    settled, done = False, 0
    for t in range(iterations):
        done += 1
        opening = max(window * math.exp(-decay * t), min_window)
        _move(points, pose, moved)
        _associate(xy, bearings, linked, moved, math.inf, opening, max_distance, targets, squares, indices)
        _associate_range(xy, bearings, ranges, linked, moved, opening, max_distance, same_range, range_squares)
        if _trim(squares, final_trim if settled else trim, kept) < 3:
            break
        fit = _rigid_fit(points, targets, kept)
        if _trim(range_squares, final_trim if settled else trim, range_kept) >= 3:
            fit = (fit[0], fit[1], _rigid_fit(points, same_range, range_kept)[2])
        if _take(fit, pose, epsilon if settled else _COARSE * epsilon) and opening <= min_window:
            if settled:
                break
            settled = True
    _move(points, pose, moved)
    _associate(xy, bearings, linked, moved, math.inf, min_window, max_distance, targets, squares, indices)
    _trim(squares, final_trim, kept)
    return _closing(points, pose, moved, targets, kept, math.inf, done)


@njit(cache=True)
def mbicp(
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    linked: NDArray[np.bool_],
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    length: float,
    window: float,
    max_distance: float,
    trim: float,
    final_trim: float,
    iterations: int,
    epsilon: float,
) -> _Result:
    """Closest points and least squares, both in the metric that weighs a turn by `length`."""
    pose = start.copy()
    moved, targets, squares, kept, indices = _buffers(len(points))
    settled, done = False, 0
    for _ in range(iterations):
        done += 1
        _move(points, pose, moved)
        _associate(xy, bearings, linked, moved, length**2, window, max_distance, targets, squares, indices)
        _drop_hidden(moved, squares)
        if _trim(squares, final_trim if settled else trim, kept) < 3:
            break
        H, g = _metric_normal_equations(moved, targets, kept, length**2)
        step = np.linalg.solve(H, g)
        if _take(_composed(step[0], step[1], step[2], pose), pose, epsilon if settled else _COARSE * epsilon):
            if settled:
                break
            settled = True
    return _closing(points, pose, moved, targets, kept, length**2, done)


@njit(cache=True)
def plicp(
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    max_distance: float,
    trim: float,
    adaptive_order: float,
    adaptive_factor: float,
    range_sigma: float,
    damping: float,
    iterations: int,
    epsilon: float,
) -> _Result:
    """Distances to the lines through the two nearest reference points, minimised in closed form.

    The adaptive limit joins the fixed quantile once the iterations have settled: far from the optimum it would keep
    only what agrees by chance.
    """
    pose = start.copy()
    settled = False
    n = len(points)
    moved = np.empty((n, 2))
    first, second, normals = np.full(n, -1), np.full(n, -1), np.empty((n, 2))
    squares, kept = np.empty(n), np.zeros(n, np.bool_)
    done = 0
    for _ in range(iterations):
        done += 1
        _move(points, pose, moved)
        _associate_lines(xy, bearings, moved, max_distance, first, second, normals, squares)
        _drop_doubles(first, squares, len(xy))
        if _trim_adaptively(squares, trim, adaptive_order, adaptive_factor if settled else math.inf, kept) < 3:
            break
        x, y, angle = line_fit(moved, xy, first, normals, kept, damping)
        if _take(_composed(x, y, angle, pose), pose, epsilon if settled else _COARSE * epsilon):
            if settled:
                break
            settled = True
    _move(points, pose, moved)
    H, M, stats = _line_closing(xy, moved, pose, first, second, normals, kept, range_sigma)
    stats[2] = done
    return pose, H, M, stats


@njit(cache=True)
def closest(
    x: float,
    y: float,
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    linked: NDArray[np.bool_],
    length2: float,
    window: float,
    limit2: float,
    hint: int,
) -> tuple[float, float, float, int]:
    """Closest point of the reference to (x, y): target x, y, squared distance and index; index -1 if there is none.

    The hint is where it was last time, -1 if unknown: it bounds the search and changes nothing else.

    Distances are in the metric d² = |δ|² − (δ × p)²/(|p|² + `length2`), Euclidean for an infinite length. Between
    linked neighbours the whole segment counts, elsewhere the points only.
    """
    n = len(xy)
    r2 = x * x + y * y
    reach = math.sqrt(r2) if math.isinf(length2) else math.sqrt(r2 * length2 / (r2 + length2))
    bearing = _unwrapped(math.atan2(y, x), bearings[0])
    start = _lower_bound(bearings, bearing)
    best2, found, fx, fy = limit2, -1, 0.0, 0.0
    if hint >= 0 and math.pi - abs(abs(bearings[hint] - bearing) - math.pi) <= window:
        qx, qy, d2 = _nearest_on(x, y, r2, xy, hint, linked[hint], length2)
        if d2 < best2:
            best2, found, fx, fy = d2, hint, qx, qy
    limit = min(window, _farthest_turn(reach, best2))
    for k in range(n):
        j, delta = start + k, -bearing
        if j >= n:
            j, delta = j - n, delta + 2.0 * math.pi
        if delta + bearings[j] > limit:
            break
        qx, qy, d2 = _nearest_on(x, y, r2, xy, j, linked[j], length2)
        if d2 < best2:
            best2, found, fx, fy = d2, j, qx, qy
            limit = min(window, _farthest_turn(reach, best2))
    for k in range(n):
        j, delta = start - 1 - k, bearing
        if j < 0:
            j, delta = j + n, delta + 2.0 * math.pi
        # A linked piece reaches from j up to the next point, which is nearer by one beam.
        nearest = j + 1 if linked[j] and j + 1 < n else j
        if delta - bearings[nearest] > limit and not (linked[j] and j + 1 == n):
            break
        qx, qy, d2 = _nearest_on(x, y, r2, xy, j, linked[j], length2)
        if d2 < best2:
            best2, found, fx, fy = d2, j, qx, qy
            limit = min(window, _farthest_turn(reach, best2))
    return fx, fy, best2, found


@njit(cache=True)
def matching_range(
    x: float,
    y: float,
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    ranges: NDArray[np.float64],
    linked: NDArray[np.bool_],
    window: float,
) -> tuple[float, float, bool]:
    """Point of the reference at the same range as (x, y) whose bearing is nearest, within ±`window`.

    Where no linked pair of neighbours spans the range, the point of the least difference in range.
    """
    n = len(xy)
    r = math.hypot(x, y)
    bearing = _unwrapped(math.atan2(y, x), bearings[0])
    start = _lower_bound(bearings, bearing)
    best, crossing, least, found = window, False, math.inf, False
    qx, qy = 0.0, 0.0
    for side in range(2):
        for k in range(n):
            j, delta = (start + k, -bearing) if side == 0 else (start - 1 - k, -bearing)
            if j >= n:
                j, delta = j - n, delta + 2.0 * math.pi
            elif j < 0:
                j, delta = j + n, delta - 2.0 * math.pi
            delta += bearings[j]
            after, width = j + 1, 0.0
            if j + 1 < n:
                width = bearings[j + 1] - bearings[j]
            elif linked[j]:
                after, width = 0, bearings[0] - bearings[j] + 2.0 * math.pi
            if (delta if side == 0 else -delta - width) > best:
                break
            gap = abs(ranges[j] - r)
            if not crossing and gap < least and abs(delta) <= window:
                least, found, qx, qy = gap, True, xy[j, 0], xy[j, 1]
            if linked[j] and (ranges[j] - r) * (ranges[after] - r) <= 0.0:
                share = 0.0 if ranges[after] == ranges[j] else (r - ranges[j]) / (ranges[after] - ranges[j])
                turn = abs(delta + share * width)
                if turn <= best:
                    best, crossing, found = turn, True, True
                    qx = xy[j, 0] + share * (xy[after, 0] - xy[j, 0])
                    qy = xy[j, 1] + share * (xy[after, 1] - xy[j, 1])
    return qx, qy, found


@njit(cache=True)
def line_fit(
    moved: NDArray[np.float64],
    xy: NDArray[np.float64],
    first: NDArray[np.int64],
    normals: NDArray[np.float64],
    kept: NDArray[np.bool_],
    damping: float,
) -> tuple[float, float, float]:
    """The motion (x, y, angle) that minimises Σ (nᵀ(R p + t − q))² exactly.

    Linear in (t, cos, sin) under cos² + sin² = 1: t is eliminated, and the Lagrange multiplier of the constraint is the
    root of a decreasing function. Damping pulls t to 0 where the normals leave it free.
    """
    A = np.zeros((2, 2))
    B = np.zeros((2, 2))
    D = np.zeros((2, 2))
    at, az = np.zeros(2), np.zeros(2)
    count = 0
    for i in range(len(moved)):
        if not kept[i]:
            continue
        count += 1
        px, py = moved[i]
        nx, ny = normals[i]
        j = first[i]
        d = nx * xy[j, 0] + ny * xy[j, 1]
        c, s = nx * px + ny * py, ny * px - nx * py
        A[0, 0] += nx * nx
        A[0, 1] += nx * ny
        A[1, 1] += ny * ny
        B[0, 0] += nx * c
        B[0, 1] += nx * s
        B[1, 0] += ny * c
        B[1, 1] += ny * s
        D[0, 0] += c * c
        D[0, 1] += c * s
        D[1, 1] += s * s
        at[0] += nx * d
        at[1] += ny * d
        az[0] += c * d
        az[1] += s * d
    A[0, 0] += damping * count
    A[1, 1] += damping * count
    A[1, 0], D[1, 0] = A[0, 1], D[0, 1]
    inverse = np.linalg.inv(A)
    S = D - B.T @ inverse @ B
    h = B.T @ inverse @ at - az
    angle = _unit_minimum(S, h)
    t = inverse @ (at - B @ np.array([math.cos(angle), math.sin(angle)]))
    return t[0], t[1], angle


@njit(cache=True)
def agreement(
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    linked: NDArray[np.bool_],
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    inlier: float,
    known: float,
) -> tuple[int, int]:
    """How many points lie within `inlier` of the reference's surface, and within `known` of it."""
    moved = np.empty_like(points)
    _move(points, pose, moved)
    inliers, overlapping = 0, 0
    for i in range(len(moved)):
        _, _, d2, j = closest(moved[i, 0], moved[i, 1], xy, bearings, linked, math.inf, math.pi, known * known, -1)
        if j >= 0:
            overlapping += 1
            inliers += d2 <= inlier * inlier
    return inliers, overlapping


@njit(cache=True)
def _buffers(
    n: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.int64]]:
    """Moved points, their targets, squared distances, which pairs are kept, and indices of the targets."""
    return np.empty((n, 2)), np.empty((n, 2)), np.empty(n), np.zeros(n, np.bool_), np.full(n, -1)


@njit(cache=True)
def _lower_bound(values: NDArray[np.float64], value: float) -> int:
    low, high = 0, len(values)
    while low < high:
        middle = (low + high) // 2
        if values[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True)
def _unwrapped(angle: float, base: float) -> float:
    """The same angle in [base, base + 2π)."""
    while angle < base:
        angle += 2.0 * math.pi
    while angle >= base + 2.0 * math.pi:
        angle -= 2.0 * math.pi
    return angle


@njit(cache=True)
def _farthest_turn(reach: float, best2: float) -> float:
    """How far round something may lie and still be as near as √best2."""
    if best2 >= reach * reach:
        return math.pi
    return math.asin(math.sqrt(best2) / reach)


@njit(cache=True)
def _nearest_on(
    x: float, y: float, r2: float, xy: NDArray[np.float64], j: int, whole: bool, length2: float
) -> tuple[float, float, float]:
    """Nearest to (x, y) of point j or, if `whole`, of the segment from it to the next: x, y, squared distance."""
    k = 1.0 / (r2 + length2)
    ax, ay = xy[j, 0] - x, xy[j, 1] - y
    turn = ax * y - ay * x
    if not whole:
        return xy[j, 0], xy[j, 1], ax * ax + ay * ay - k * turn * turn
    after = j + 1 if j + 1 < len(xy) else 0
    ex, ey = xy[after, 0] - xy[j, 0], xy[after, 1] - xy[j, 1]
    e_turn = ex * y - ey * x
    quadratic = ex * ex + ey * ey - k * e_turn * e_turn
    linear = ax * ex + ay * ey - k * turn * e_turn
    share = 0.0 if quadratic <= 0.0 else min(1.0, max(0.0, -linear / quadratic))
    ax, ay, turn = ax + share * ex, ay + share * ey, turn + share * e_turn
    return x + ax, y + ay, ax * ax + ay * ay - k * turn * turn


@njit(cache=True)
def _move(points: NDArray[np.float64], pose: NDArray[np.float64], moved: NDArray[np.float64]) -> None:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(len(points)):
        px, py = points[i]
        moved[i, 0] = pose[0] + c * px - s * py
        moved[i, 1] = pose[1] + s * px + c * py


@njit(cache=True)
def _associate(
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    linked: NDArray[np.bool_],
    moved: NDArray[np.float64],
    length2: float,
    window: float,
    max_distance: float,
    targets: NDArray[np.float64],
    squares: NDArray[np.float64],
    indices: NDArray[np.int64],
) -> None:
    """Closest point of every moved point; squared distance inf where there is none. Indices serve as hints."""
    limit2 = max_distance * max_distance
    for i in range(len(moved)):
        x, y, d2, j = closest(moved[i, 0], moved[i, 1], xy, bearings, linked, length2, window, limit2, indices[i])
        indices[i] = j
        targets[i, 0], targets[i, 1] = x, y
        squares[i] = d2 if j >= 0 else math.inf


@njit(cache=True)
def _associate_range(
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    ranges: NDArray[np.float64],
    linked: NDArray[np.bool_],
    moved: NDArray[np.float64],
    window: float,
    max_distance: float,
    targets: NDArray[np.float64],
    squares: NDArray[np.float64],
) -> None:
    """Point at matching range of every moved point; the squared difference in range must stay small."""
    for i in range(len(moved)):
        x, y, found = matching_range(moved[i, 0], moved[i, 1], xy, bearings, ranges, linked, window)
        targets[i, 0], targets[i, 1] = x, y
        gap = math.hypot(x, y) - math.hypot(moved[i, 0], moved[i, 1])
        squares[i] = gap * gap if found and abs(gap) <= max_distance else math.inf


@njit(cache=True)
def _associate_lines(
    xy: NDArray[np.float64],
    bearings: NDArray[np.float64],
    moved: NDArray[np.float64],
    max_distance: float,
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    normals: NDArray[np.float64],
    squares: NDArray[np.float64],
) -> None:
    """Nearest reference point, the nearer of its two neighbours, and the normal of the line through both."""
    n = len(xy)
    no_links = np.zeros(n, np.bool_)
    for i in range(len(moved)):
        x, y = moved[i]
        _, _, _, j = closest(x, y, xy, bearings, no_links, math.inf, math.pi, max_distance * max_distance, first[i])
        squares[i] = math.inf
        first[i] = j
        if j < 0:
            continue
        other, nearest = -1, math.inf
        for k in (j - 1, j + 1):
            if 0 <= k < n:
                d2 = (xy[k, 0] - x) ** 2 + (xy[k, 1] - y) ** 2
                if d2 < nearest:
                    other, nearest = k, d2
        ex, ey = xy[other, 0] - xy[j, 0], xy[other, 1] - xy[j, 1]
        length = math.hypot(ex, ey)
        second[i] = other
        if length > 0.0:
            normals[i, 0], normals[i, 1] = -ey / length, ex / length
            squares[i] = (normals[i, 0] * (x - xy[j, 0]) + normals[i, 1] * (y - xy[j, 1])) ** 2


@njit(cache=True)
def _drop_doubles(first: NDArray[np.int64], squares: NDArray[np.float64], n: int) -> None:
    """Of the points that share a nearest reference point only the one with the least error stays."""
    owner = np.full(n, -1, np.int64)
    for i in range(len(first)):
        if math.isinf(squares[i]):
            continue
        j = first[i]
        if owner[j] < 0:
            owner[j] = i
        elif squares[i] < squares[owner[j]]:
            squares[owner[j]] = math.inf
            owner[j] = i
        else:
            squares[i] = math.inf


@njit(cache=True)
def _drop_hidden(moved: NDArray[np.float64], squares: NDArray[np.float64]) -> None:
    """Points that fall behind an earlier one in bearing order cannot have been seen from the reference."""
    turned, farthest, last = 0.0, -math.inf, math.atan2(moved[0, 1], moved[0, 0])
    for i in range(len(moved)):
        bearing = math.atan2(moved[i, 1], moved[i, 0])
        step = (bearing - last + math.pi) % (2.0 * math.pi) - math.pi
        turned += step
        last = bearing
        if turned < farthest:
            squares[i] = math.inf
        else:
            farthest = turned


@njit(cache=True)
def _trim(squares: NDArray[np.float64], share: float, kept: NDArray[np.bool_]) -> int:
    """Mark the `share` of the finite entries that is smallest; return how many."""
    finite = squares[np.isfinite(squares)]
    kept[:] = False
    if len(finite) == 0:
        return 0
    last = min(len(finite) - 1, math.ceil(share * len(finite)) - 1)
    limit = np.partition(finite, last)[last]
    count = 0
    for i in range(len(squares)):
        kept[i] = squares[i] <= limit
        count += kept[i]
    return count


@njit(cache=True)
def _trim_adaptively(
    squares: NDArray[np.float64], share: float, order: float, factor: float, kept: NDArray[np.bool_]
) -> int:
    """Censi's two rules: a fixed quantile of the errors, and `factor` times a lower one."""
    finite = squares[np.isfinite(squares)]
    kept[:] = False
    if len(finite) == 0:
        return 0
    finite.sort()
    last = len(finite) - 1
    fixed = finite[min(last, int(share * len(finite)))]
    adaptive = factor * factor * finite[min(last, int(order * len(finite)))]
    limit = min(fixed, adaptive)
    count = 0
    for i in range(len(squares)):
        kept[i] = squares[i] <= limit
        count += kept[i]
    return count


@njit(cache=True)
def _rigid_fit(
    points: NDArray[np.float64], targets: NDArray[np.float64], kept: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """The pose that takes the kept points nearest to their targets, in closed form."""
    n, px, py, qx, qy = 0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(points)):
        if kept[i]:
            n += 1
            px += points[i, 0]
            py += points[i, 1]
            qx += targets[i, 0]
            qy += targets[i, 1]
    px, py, qx, qy = px / n, py / n, qx / n, qy / n
    dot, cross = 0.0, 0.0
    for i in range(len(points)):
        if kept[i]:
            ax, ay = points[i, 0] - px, points[i, 1] - py
            bx, by = targets[i, 0] - qx, targets[i, 1] - qy
            dot += ax * bx + ay * by
            cross += ax * by - ay * bx
    angle = math.atan2(cross, dot)
    c, s = math.cos(angle), math.sin(angle)
    return qx - c * px + s * py, qy - s * px - c * py, angle


@njit(cache=True)
def _metric_normal_equations(
    moved: NDArray[np.float64], targets: NDArray[np.float64], kept: NDArray[np.bool_], length2: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """H and g of the step x that minimises Σ δᵀWδ, δ = q − p − Jx, W = I − kkᵀ/(|p|² + L²), k = (p_y, −p_x)."""
    H, g = np.zeros((3, 3)), np.zeros(3)
    for i in range(len(moved)):
        if not kept[i]:
            continue
        x, y = moved[i]
        dx, dy = targets[i, 0] - x, targets[i, 1] - y
        r2 = x * x + y * y
        k = 1.0 / (r2 + length2)
        turn = dx * y - dy * x
        # The columns of J are e₁, e₂ and (−y, x); J₃ᵀk = −|p|².
        H[0, 0] += 1.0 - k * y * y
        H[0, 1] += k * x * y
        H[1, 1] += 1.0 - k * x * x
        H[0, 2] -= y - k * r2 * y
        H[1, 2] += x - k * r2 * x
        H[2, 2] += r2 - k * r2 * r2
        g[0] += dx - k * turn * y
        g[1] += dy + k * turn * x
        g[2] += -turn + k * turn * r2
    H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]
    return H, g


@njit(cache=True)
def _unit_minimum(S: NDArray[np.float64], h: NDArray[np.float64]) -> float:
    """Angle of the unit vector z that minimises zᵀSz + 2hᵀz: (S + λI)z = −h with the largest λ that makes |z| = 1."""
    half, off = 0.5 * (S[0, 0] - S[1, 1]), S[0, 1]
    radius = math.hypot(half, off)
    axis = 0.5 * math.atan2(off, half)
    c, s = math.cos(axis), math.sin(axis)
    high, low = c * h[0] + s * h[1], c * h[1] - s * h[0]  # h along the eigenvectors of mean ± radius
    # With λ measured from −(mean − radius): low²/λ² + high²/(λ + 2 radius)² = 1 has one root in (0, |h|].
    below, above = abs(low), math.hypot(low, high)
    if above == 0.0:
        return axis + 0.5 * math.pi
    for _ in range(60):
        x = 0.5 * (below + above)
        if (low / x) ** 2 + (high / (x + 2.0 * radius)) ** 2 > 1.0:
            below = x
        else:
            above = x
    along = -high / (above + 2.0 * radius)
    across = math.copysign(math.sqrt(max(0.0, 1.0 - along * along)), -low)
    return math.atan2(s * along + c * across, c * along - s * across)


@njit(cache=True)
def _composed(x: float, y: float, angle: float, pose: NDArray[np.float64]) -> tuple[float, float, float]:
    """A motion in the reference frame after the pose so far."""
    c, s = math.cos(angle), math.sin(angle)
    return x + c * pose[0] - s * pose[1], y + s * pose[0] + c * pose[1], pose[2] + angle


@njit(cache=True)
def _take(fit: tuple[float, float, float], pose: NDArray[np.float64], epsilon: float) -> bool:
    """Make the fit the pose; true when it moved by less than `epsilon` in metres and radians."""
    turn = (fit[2] - pose[2] + math.pi) % (2.0 * math.pi) - math.pi
    step = math.hypot(fit[0] - pose[0], fit[1] - pose[1])
    pose[0], pose[1] = fit[0], fit[1]
    pose[2] = (fit[2] + math.pi) % (2.0 * math.pi) - math.pi
    return step < epsilon and abs(turn) < epsilon


@njit(cache=True)
def _closing(
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    moved: NDArray[np.float64],
    targets: NDArray[np.float64],
    kept: NDArray[np.bool_],
    length2: float,
    iterations: int,
) -> _Result:
    """H at the midpoints of the last pairs and M = s²H, s² = Σ d²/(2n − 3) (Lu and Milios)."""
    _move(points, pose, moved)
    middles = 0.5 * (moved + targets)
    H, _ = _metric_normal_equations(middles, targets, kept, length2)
    n, total = 0, 0.0
    for i in range(len(points)):
        if kept[i]:
            n += 1
            x, y = middles[i]
            dx, dy = targets[i, 0] - moved[i, 0], targets[i, 1] - moved[i, 1]
            total += dx * dx + dy * dy - (dx * y - dy * x) ** 2 / (x * x + y * y + length2)
    stats = np.array([float(n), total / max(n, 1), float(iterations)])
    return pose, H, H * (total / max(2 * n - 3, 1)), stats


@njit(cache=True)
def _line_closing(
    xy: NDArray[np.float64],
    moved: NDArray[np.float64],
    pose: NDArray[np.float64],
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    normals: NDArray[np.float64],
    kept: NDArray[np.bool_],
    range_sigma: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """How the noise of every range of both scans moves the minimum: H = Σaaᵀ, M = σ² Σ (∂g/∂ρ)(∂g/∂ρ)ᵀ."""
    H, M = np.zeros((3, 3)), np.zeros((3, 3))
    of_reference = np.zeros((len(xy), 3))
    n, total = 0, 0.0
    a = np.empty(3)
    for i in range(len(moved)):
        if not kept[i]:
            continue
        n += 1
        x, y = moved[i]
        nx, ny = normals[i]
        j, k = first[i], second[i]
        error = nx * (x - xy[j, 0]) + ny * (y - xy[j, 1])
        total += error * error
        a[0], a[1], a[2] = nx, ny, ny * x - nx * y
        H += np.outer(a, a)
        bx, by = x - pose[0], y - pose[1]
        own = (nx * bx + ny * by) / max(math.hypot(bx, by), 1e-9)
        M += np.outer(a, a) * own**2
        # Where the foot of the perpendicular lies between the two reference points decides how much each moves it.
        ex, ey = xy[k, 0] - xy[j, 0], xy[k, 1] - xy[j, 1]
        share = ((x - xy[j, 0]) * ex + (y - xy[j, 1]) * ey) / (ex * ex + ey * ey)
        for point, weight in ((j, 1.0 - share), (k, share)):
            r = max(math.hypot(xy[point, 0], xy[point, 1]), 1e-9)
            of_reference[point] -= a * (weight * (nx * xy[point, 0] + ny * xy[point, 1]) / r)
    M = range_sigma**2 * (M + of_reference.T @ of_reference)
    return H, M, np.array([float(n), total / max(n, 1), 0.0])
