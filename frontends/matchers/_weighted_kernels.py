"""Compiled parts of weighted scan matching: point covariances, a quad tree, and the iterations of WSM and QWSM.

A symmetric 2x2 matrix is a row (xx, xy, yy). A quad tree is four arrays: `boxes` (m, 3) centre and half width of each
node, `children` (m, 4) with -1 where there is none, `leaves` (m, 2) first place and count in `order`, (n,) the points
leaf by leaf; node 0 is the root.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_Tree = tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]
_BUCKET = 6
_MAX_DEPTH = 24


@njit(cache=True)
def point_model(
    xy: NDArray[np.float64],
    linked: NDArray[np.bool_],
    resolution: float,
    range_sigma: float,
    angle_sigma: float,
    neighbours: int,
    max_spread: float,
    noise: NDArray[np.float64],
    tangents: NDArray[np.float64],
    spreads: NDArray[np.float64],
) -> None:
    """Fill noise covariance, direction of the wall and standard deviation of a correspondence along it, per point."""
    n = len(xy)
    for i in range(n):
        x, y = xy[i]
        r = max(math.hypot(x, y), 1e-6)
        ux, uy = x / r, y / r
        along_beam, across = range_sigma**2, (r * angle_sigma) ** 2
        noise[i, 0] = along_beam * ux * ux + across * uy * uy
        noise[i, 1] = (along_beam - across) * ux * uy
        noise[i, 2] = along_beam * uy * uy + across * ux * ux
        tangents[i, 0], tangents[i, 1] = _wall_direction(xy, linked, i, neighbours)
        if tangents[i, 0] == 0.0 and tangents[i, 1] == 0.0:
            tangents[i, 0], tangents[i, 1] = -uy, ux
        incidence = math.acos(min(1.0, abs(tangents[i, 0] * ux + tangents[i, 1] * uy)))
        step = r * math.sin(resolution)
        shorter = min(max_spread, step / max(math.sin(min(incidence + resolution, 0.5 * math.pi)), 1e-3))
        longer = min(max_spread, step / max(math.sin(incidence - resolution), 1e-3))
        spreads[i] = math.sqrt((shorter**3 + longer**3) / (3.0 * (shorter + longer)))


@njit(cache=True)
def place(
    xy: NDArray[np.float64],
    noise: NDArray[np.float64],
    tangents: NDArray[np.float64],
    pose: NDArray[np.float64],
    out_xy: NDArray[np.float64],
    out_noise: NDArray[np.float64],
    out_tangents: NDArray[np.float64],
) -> None:
    """Move points with their covariances and wall directions into another frame."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(len(xy)):
        x, y = xy[i]
        out_xy[i, 0], out_xy[i, 1] = pose[0] + c * x - s * y, pose[1] + s * x + c * y
        tx, ty = tangents[i]
        out_tangents[i, 0], out_tangents[i, 1] = c * tx - s * ty, s * tx + c * ty
        out_noise[i, 0], out_noise[i, 1], out_noise[i, 2] = _rotated(noise[i, 0], noise[i, 1], noise[i, 2], c, s)


@njit(cache=True)
def build_tree(xy: NDArray[np.float64]) -> _Tree:
    """Divide the points' square into four until a node holds few of them."""
    n = len(xy)
    order = np.arange(n).astype(np.int32)
    capacity = 16 + 4 * n
    boxes = np.empty((capacity, 3))
    children, leaves = np.full((capacity, 4), -1, np.int32), np.zeros((capacity, 2), np.int32)
    if n == 0:
        boxes[0] = 0.0
        return boxes[:1], children[:1], leaves[:1], order
    x_min, x_max, y_min, y_max = xy[:, 0].min(), xy[:, 0].max(), xy[:, 1].min(), xy[:, 1].max()
    boxes[0, 0], boxes[0, 1] = 0.5 * (x_min + x_max), 0.5 * (y_min + y_max)
    boxes[0, 2] = 0.5 * max(x_max - x_min, y_max - y_min) + 1e-9
    leaves[0, 1] = n
    depth = np.zeros(capacity, np.int32)
    sorted_, quadrant = np.empty(n, np.int32), np.empty(n, np.int32)
    node, count = 0, 1
    while node < count:
        first, size = leaves[node]
        if size > _BUCKET and depth[node] < _MAX_DEPTH and count + 4 <= capacity:
            leaves[node, 1] = 0
            cx, cy, half = boxes[node]
            for k in range(first, first + size):
                quadrant[k] = (xy[order[k], 0] >= cx) + 2 * (xy[order[k], 1] >= cy)
            place_in = first
            for q in range(4):
                begin = place_in
                for k in range(first, first + size):
                    if quadrant[k] == q:
                        sorted_[place_in] = order[k]
                        place_in += 1
                if place_in > begin:
                    children[node, q] = count
                    boxes[count, 0] = cx + (0.5 if q % 2 == 1 else -0.5) * half
                    boxes[count, 1] = cy + (0.5 if q >= 2 else -0.5) * half
                    boxes[count, 2] = 0.5 * half
                    leaves[count, 0], leaves[count, 1] = begin, place_in - begin
                    depth[count] = depth[node] + 1
                    count += 1
            order[first : first + size] = sorted_[first : first + size]
        node += 1
    return boxes[:count].copy(), children[:count].copy(), leaves[:count].copy(), order


@njit(cache=True)
def nearest(
    x: float,
    y: float,
    xy: NDArray[np.float64],
    boxes: NDArray[np.float64],
    children: NDArray[np.int32],
    leaves: NDArray[np.int32],
    order: NDArray[np.int32],
    stack: NDArray[np.int32],
    limit2: float,
    hint: int,
) -> tuple[int, float]:
    """Nearest point of a quad tree and its squared distance, index -1 if none is nearer than √limit2.

    The hint, a point that may be near or -1, bounds the search; `stack` is room for 128 nodes.
    """
    best, best2 = -1, limit2
    if hint >= 0:
        d2 = (xy[hint, 0] - x) ** 2 + (xy[hint, 1] - y) ** 2
        if d2 < best2:
            best, best2 = hint, d2
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        dx = max(0.0, abs(x - boxes[node, 0]) - boxes[node, 2])
        dy = max(0.0, abs(y - boxes[node, 1]) - boxes[node, 2])
        if dx * dx + dy * dy >= best2:
            continue
        first, size = leaves[node]
        for k in range(first, first + size):
            j = order[k]
            d2 = (xy[j, 0] - x) ** 2 + (xy[j, 1] - y) ** 2
            if d2 < best2:
                best, best2 = j, d2
        own = (x >= boxes[node, 0]) + 2 * (y >= boxes[node, 1])
        for q in (3, 2, 1):  # the quadrant of the query last, so that it is searched first
            child = children[node, own ^ q]
            if child >= 0:
                stack[top] = child
                top += 1
        child = children[node, own]
        if child >= 0:
            stack[top] = child
            top += 1
    return best, best2


@njit(cache=True)
def nearest_all(
    queries: NDArray[np.float64],
    xy: NDArray[np.float64],
    boxes: NDArray[np.float64],
    children: NDArray[np.int32],
    leaves: NDArray[np.int32],
    order: NDArray[np.int32],
    limit2: float,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """`nearest` of many queries."""
    found, squares = np.empty(len(queries), np.int64), np.empty(len(queries))
    stack = np.empty(128, np.int32)
    for i in range(len(queries)):
        found[i], squares[i] = nearest(
            queries[i, 0], queries[i, 1], xy, boxes, children, leaves, order, stack, limit2, -1
        )
    return found, squares


@njit(cache=True)
def weighted_match(
    xy: NDArray[np.float64],
    noise: NDArray[np.float64],
    tangents: NDArray[np.float64],
    spreads: NDArray[np.float64],
    tree: _Tree,
    points: NDArray[np.float64],
    point_noise: NDArray[np.float64],
    point_tree: _Tree,
    start: NDArray[np.float64],
    mutual: bool,
    max_distance: float,
    trim: float,
    gate: float,
    iterations: int,
    coarse_epsilon: float,
    epsilon: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Weighted least squares on nearest pairs, translation and rotation in turn, until nothing moves.

    The farthest pairs are trimmed by distance. If `mutual`, those that are not each other's nearest go too, once the
    steps are below `coarse_epsilon`; and once nothing moves any more, those beyond the Mahalanobis gate. Far from the
    optimum either rule would keep chance pairs.

    Returns:
        The pose; H, (3, 3) information of a small motion (x, y, θ) in the frame and about the origin of the reference;
        (pairs, mean square distance, iterations).
    """
    pose = start.copy()
    n = len(points)
    pairs, weights, errors = np.full(n, -1), np.empty((n, 3)), np.empty((n, 2))
    moved, kept = np.empty((n, 2)), np.zeros(n, np.bool_)
    sums = np.zeros(6)
    stage, done = 0, 0
    for _ in range(iterations):
        done += 1
        _associate(xy, tree, points, point_tree, pose, mutual and stage > 0, max_distance, moved, pairs)
        _weigh(xy, noise, tangents, spreads, point_noise, pose, moved, pairs, weights, errors)
        count = _select(errors, weights, pairs, trim, gate if stage == 2 else math.inf, kept)
        if count < 3:
            break
        tx, ty, turn = _solve(moved, errors, weights, kept, sums)
        mx, my = sums[3], sums[4]
        c, s = math.cos(turn), math.sin(turn)
        dx, dy = pose[0] - mx, pose[1] - my
        new_x, new_y = mx + c * dx - s * dy + tx, my + s * dx + c * dy + ty
        step = math.hypot(new_x - pose[0], new_y - pose[1])
        pose[0], pose[1] = new_x, new_y
        pose[2] = (pose[2] + turn + math.pi) % (2.0 * math.pi) - math.pi
        if max(step, abs(turn)) < (coarse_epsilon if mutual and stage == 0 else epsilon):
            if stage == 2:
                break
            stage = stage + 1 if mutual else 2
    return pose, _information(sums), _statistics(errors, kept, done)


@njit(cache=True)
def weighted_agreement(
    xy: NDArray[np.float64],
    tangents: NDArray[np.float64],
    spreads: NDArray[np.float64],
    tree: _Tree,
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    inlier: float,
    known: float,
) -> tuple[int, int]:
    """How many points lie within `inlier` of the reference's surface, and within `known` of it.

    A reference point stands for its wall as far as neighbouring beams lie apart.
    """
    boxes, children, leaves, order = tree
    stack = np.empty(128, np.int32)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    inliers, overlapping = 0, 0
    for i in range(len(points)):
        px, py = points[i]
        x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        j, _ = nearest(x, y, xy, boxes, children, leaves, order, stack, (2.0 * known) ** 2, -1)
        if j < 0:
            continue
        dx, dy = x - xy[j, 0], y - xy[j, 1]
        along = max(0.0, abs(dx * tangents[j, 0] + dy * tangents[j, 1]) - 2.0 * spreads[j])
        across = dx * tangents[j, 1] - dy * tangents[j, 0]
        distance2 = along * along + across * across
        overlapping += distance2 <= known * known
        inliers += distance2 <= inlier * inlier
    return inliers, overlapping


@njit(cache=True)
def _wall_direction(xy: NDArray[np.float64], linked: NDArray[np.bool_], i: int, neighbours: int) -> tuple[float, float]:
    """Unit vector along the line through a point and its linked neighbours; 0, 0 where it has none."""
    n = len(xy)
    first, last = i, i
    while first > 0 and i - first < neighbours and linked[first - 1]:
        first -= 1
    while last < n - 1 and last - i < neighbours and linked[last]:
        last += 1
    if last == first:
        return 0.0, 0.0
    count = last - first + 1
    mx, my = xy[first : last + 1, 0].mean(), xy[first : last + 1, 1].mean()
    xx, xy_, yy = 0.0, 0.0, 0.0
    for k in range(first, last + 1):
        dx, dy = xy[k, 0] - mx, xy[k, 1] - my
        xx += dx * dx / count
        xy_ += dx * dy / count
        yy += dy * dy / count
    angle = 0.5 * math.atan2(2.0 * xy_, xx - yy)
    return math.cos(angle), math.sin(angle)


@njit(cache=True)
def _rotated(xx: float, xy: float, yy: float, c: float, s: float) -> tuple[float, float, float]:
    """R P Rᵀ."""
    return (
        c * c * xx - 2.0 * c * s * xy + s * s * yy,
        c * s * (xx - yy) + (c * c - s * s) * xy,
        s * s * xx + 2.0 * c * s * xy + c * c * yy,
    )


@njit(cache=True)
def _associate(
    xy: NDArray[np.float64],
    tree: _Tree,
    points: NDArray[np.float64],
    point_tree: _Tree,
    pose: NDArray[np.float64],
    mutual: bool,
    max_distance: float,
    moved: NDArray[np.float64],
    pairs: NDArray[np.int64],
) -> None:
    """Nearest reference point of every moved point, -1 if none is near or, if `mutual`, nearer to another point."""
    boxes, children, leaves, order = tree
    own_boxes, own_children, own_leaves, own_order = point_tree
    stack = np.empty(128, np.int32)
    limit2 = max_distance * max_distance
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(len(points)):
        px, py = points[i]
        moved[i, 0], moved[i, 1] = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        j, d2 = nearest(moved[i, 0], moved[i, 1], xy, boxes, children, leaves, order, stack, limit2, pairs[i])
        pairs[i] = j
        if mutual and j >= 0:
            qx, qy = xy[j, 0] - pose[0], xy[j, 1] - pose[1]
            back, _ = nearest(
                c * qx + s * qy,
                c * qy - s * qx,
                points,
                own_boxes,
                own_children,
                own_leaves,
                own_order,
                stack,
                d2 + 1e-12,
                i,
            )
            if back >= 0 and back != i:
                pairs[i] = -1


@njit(cache=True)
def _weigh(
    xy: NDArray[np.float64],
    noise: NDArray[np.float64],
    tangents: NDArray[np.float64],
    spreads: NDArray[np.float64],
    point_noise: NDArray[np.float64],
    pose: NDArray[np.float64],
    moved: NDArray[np.float64],
    pairs: NDArray[np.int64],
    weights: NDArray[np.float64],
    errors: NDArray[np.float64],
) -> None:
    """Error of each pair and the inverse of its covariance P_i + R P_j Rᵀ + spread² along the wall."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(len(moved)):
        j = pairs[i]
        if j < 0:
            continue
        errors[i, 0], errors[i, 1] = xy[j, 0] - moved[i, 0], xy[j, 1] - moved[i, 1]
        xx, xy_, yy = _rotated(point_noise[i, 0], point_noise[i, 1], point_noise[i, 2], c, s)
        spread2 = spreads[j] ** 2
        xx += noise[j, 0] + spread2 * tangents[j, 0] ** 2
        xy_ += noise[j, 1] + spread2 * tangents[j, 0] * tangents[j, 1]
        yy += noise[j, 2] + spread2 * tangents[j, 1] ** 2
        determinant = xx * yy - xy_ * xy_
        weights[i, 0], weights[i, 1], weights[i, 2] = yy / determinant, -xy_ / determinant, xx / determinant


@njit(cache=True)
def _select(
    errors: NDArray[np.float64],
    weights: NDArray[np.float64],
    pairs: NDArray[np.int64],
    trim: float,
    gate: float,
    kept: NDArray[np.bool_],
) -> int:
    """Mark the `trim` of the pairs that lies nearest, of them those within `gate` standard deviations."""
    n = len(pairs)
    squares = np.full(n, math.inf)
    found = 0
    for i in range(n):
        if pairs[i] >= 0:
            squares[i] = errors[i, 0] ** 2 + errors[i, 1] ** 2
            found += 1
    kept[:] = False
    if found == 0:
        return 0
    last = min(found, math.ceil(trim * found)) - 1
    limit = np.partition(squares, last)[last]
    count = 0
    for i in range(n):
        if pairs[i] >= 0 and squares[i] <= limit:
            ex, ey = errors[i]
            m2 = weights[i, 0] * ex * ex + 2.0 * weights[i, 1] * ex * ey + weights[i, 2] * ey * ey
            kept[i] = m2 <= gate * gate
            count += kept[i]
    return count


@njit(cache=True)
def _solve(
    moved: NDArray[np.float64],
    errors: NDArray[np.float64],
    weights: NDArray[np.float64],
    kept: NDArray[np.bool_],
    sums: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Translation (ΣP⁻¹)⁻¹ΣP⁻¹ε, then the turn about the weighted midpoint that explains the rest.

    `sums` receives ΣP⁻¹ as (xx, xy, yy), the midpoint and the information on the turn.
    """
    sums[:] = 0.0
    ex, ey, px, py = 0.0, 0.0, 0.0, 0.0
    for i in range(len(moved)):
        if not kept[i]:
            continue
        a, b, d = weights[i]
        sums[0] += a
        sums[1] += b
        sums[2] += d
        ex += a * errors[i, 0] + b * errors[i, 1]
        ey += b * errors[i, 0] + d * errors[i, 1]
        px += a * moved[i, 0] + b * moved[i, 1]
        py += b * moved[i, 0] + d * moved[i, 1]
    determinant = sums[0] * sums[2] - sums[1] ** 2
    tx, ty = (sums[2] * ex - sums[1] * ey) / determinant, (sums[0] * ey - sums[1] * ex) / determinant
    mx, my = (sums[2] * px - sums[1] * py) / determinant, (sums[0] * py - sums[1] * px) / determinant
    slope, information = 0.0, 0.0
    for i in range(len(moved)):
        if not kept[i]:
            continue
        a, b, d = weights[i]
        jx, jy = my - moved[i, 1], moved[i, 0] - mx
        wx, wy = a * jx + b * jy, b * jx + d * jy
        slope += wx * (errors[i, 0] - tx) + wy * (errors[i, 1] - ty)
        information += wx * jx + wy * jy
    sums[3], sums[4], sums[5] = mx, my, information
    return tx, ty, slope / information if information > 0.0 else 0.0


@njit(cache=True)
def _information(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Block-diagonal information about the midpoint, moved to the origin of the frame."""
    about = np.zeros((3, 3))
    about[0, 0], about[0, 1], about[1, 0], about[1, 1], about[2, 2] = sums[0], sums[1], sums[1], sums[2], sums[5]
    to_middle = np.eye(3)  # a turn θ about the origin shifts the midpoint m by θ (−m_y, m_x)
    to_middle[0, 2], to_middle[1, 2] = -sums[4], sums[3]
    return to_middle.T @ about @ to_middle


@njit(cache=True)
def _statistics(errors: NDArray[np.float64], kept: NDArray[np.bool_], iterations: int) -> NDArray[np.float64]:
    count, total = 0, 0.0
    for i in range(len(kept)):
        if kept[i]:
            count += 1
            total += errors[i, 0] ** 2 + errors[i, 1] ** 2
    return np.array([float(count), total / max(count, 1), float(iterations)])
