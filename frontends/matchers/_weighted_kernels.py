"""The iterations of weighted scan matching, compiled: WSM and QWSM. A symmetric 2x2 matrix is a row (xx, xy, yy)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.matchers._point_noise_kernels import rotated
from frontends.matchers._quad_tree_kernels import Nodes, nearest
from graph._sort_kernels import _smallest
from graph.compiled import compiled


class Cloud(NamedTuple):
    """n points and what is known of them.

    Attributes:
        xy: (n, 2) [m].
        noise: (n, 3) covariance of each point [m²].
        tangents: (n, 2) unit vectors along the walls.
        spreads: (n,) standard deviation of a correspondence along the wall [m].
        ends: (n,) where unseen ground begins: 2 at the first and last point, 1 at other ends of walls, else 0.
        nodes: a quad tree over the points.
    """

    xy: NDArray[np.float64]
    noise: NDArray[np.float64]
    tangents: NDArray[np.float64]
    spreads: NDArray[np.float64]
    ends: NDArray[np.int8]
    nodes: Nodes


class Rules(NamedTuple):
    """Which pairs count and when the iterations end, see `weighted.IterationConfig`.

    Attributes:
        mutual: whether only pairs that are each other's nearest stay once the steps are below `coarse_epsilon`.
        max_distance: farthest pair [m].
        trim: share of the pairs kept, the nearest.
        gate: Mahalanobis distance of the farthest pair once nothing moves.
        iterations: most of them.
        coarse_epsilon: see `mutual` [m, rad].
        epsilon: nothing moves when a step is below this [m, rad].
    """

    mutual: bool
    max_distance: float
    trim: float
    gate: float
    iterations: int
    coarse_epsilon: float
    epsilon: float


@compiled
def weighted_match(
    reference: Cloud, scan: Cloud, start: NDArray[np.float64], rules: Rules
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Weighted least squares on nearest pairs, translation and rotation in turn, until nothing moves.

    The farthest pairs are trimmed by distance. Once nothing moves, pairs at the ends of walls go, those that are not
    each other's nearest if they must be, and those beyond the Mahalanobis gate. Far from the optimum these rules would
    keep chance pairs.

    Returns:
        The pose; H, (3, 3) information of a small motion (x, y, θ) in the frame and about the origin of the reference;
        (pairs, mean square distance, iterations).
    """
    pose = start.copy()
    n = len(scan.xy)
    pairs, weights, errors = np.full(n, -1), np.empty((n, 3)), np.empty((n, 2))
    moved, kept = np.empty((n, 2)), np.zeros(n, np.bool_)
    sums = np.zeros(6)
    stage, done = 0, 0
    while done < rules.iterations:
        done += 1
        _associate(
            reference, scan, pose, rules.mutual and stage > 0, rules.max_distance, 1 if stage > 0 else 2, moved, pairs
        )
        _weigh(reference, scan.noise, pose, moved, pairs, weights, errors)
        count = _select(errors, weights, pairs, rules.trim, rules.gate if stage == 2 else math.inf, kept)
        if count < 3:
            break
        tx, ty, turn = _solve(moved, errors, weights, kept, sums)
        step = _turn_about(sums[3], sums[4], tx, ty, turn, pose)
        if max(step, abs(turn)) < (rules.coarse_epsilon if stage == 0 else rules.epsilon):
            if stage == 2:
                break
            stage += 1
    return pose, _information(sums), _statistics(errors, kept, done)


@compiled
def _turn_about(mx: float, my: float, tx: float, ty: float, turn: float, pose: NDArray[np.float64]) -> float:
    """Turn a pose about (mx, my) and shift it; how far it moved [m]."""
    c, s = math.cos(turn), math.sin(turn)
    dx, dy = pose[0] - mx, pose[1] - my
    new_x, new_y = mx + c * dx - s * dy + tx, my + s * dx + c * dy + ty
    step = math.hypot(new_x - pose[0], new_y - pose[1])
    pose[0], pose[1] = new_x, new_y
    pose[2] = (pose[2] + turn + math.pi) % (2.0 * math.pi) - math.pi
    return step


@compiled
def weighted_agreement(
    reference: Cloud, points: NDArray[np.float64], pose: NDArray[np.float64], inlier: float, known: float
) -> tuple[int, int]:
    """How many points lie within `inlier` of the reference's surface, and within `known` of it.

    A reference point stands for its wall as far as neighbouring beams lie apart.
    """
    xy, tangents = reference.xy, reference.tangents
    stack = np.empty(128, np.int32)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    inliers, overlapping = 0, 0
    for i in range(len(points)):
        px, py = points[i]
        x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        j, _ = nearest(x, y, xy, reference.nodes, stack, (2.0 * known) ** 2, -1)
        if j < 0:
            continue
        dx, dy = x - xy[j, 0], y - xy[j, 1]
        along = max(0.0, abs(dx * tangents[j, 0] + dy * tangents[j, 1]) - 2.0 * reference.spreads[j])
        across = dx * tangents[j, 1] - dy * tangents[j, 0]
        distance2 = along * along + across * across
        overlapping += distance2 <= known * known
        inliers += distance2 <= inlier * inlier
    return inliers, overlapping


@compiled
def _associate(
    reference: Cloud,
    scan: Cloud,
    pose: NDArray[np.float64],
    mutual: bool,
    max_distance: float,
    least_end: int,
    moved: NDArray[np.float64],
    pairs: NDArray[np.int64],
) -> None:
    """Nearest reference point of every moved point, -1 if none counts: see `weighted_match`."""
    xy, points = reference.xy, scan.xy
    stack = np.empty(128, np.int32)
    limit2 = max_distance * max_distance
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(len(points)):
        px, py = points[i]
        moved[i, 0], moved[i, 1] = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        j, d2 = nearest(moved[i, 0], moved[i, 1], xy, reference.nodes, stack, limit2, pairs[i])
        pairs[i] = j if j >= 0 and reference.ends[j] < least_end else -1
        if mutual and pairs[i] >= 0:
            qx, qy = xy[j, 0] - pose[0], xy[j, 1] - pose[1]
            back, _ = nearest(c * qx + s * qy, c * qy - s * qx, points, scan.nodes, stack, d2 + 1e-12, i)
            if back >= 0 and back != i:
                pairs[i] = -1


@compiled
def _weigh(
    reference: Cloud,
    point_noise: NDArray[np.float64],
    pose: NDArray[np.float64],
    moved: NDArray[np.float64],
    pairs: NDArray[np.int64],
    weights: NDArray[np.float64],
    errors: NDArray[np.float64],
) -> None:
    """Error of each pair and the inverse of its covariance P_i + R P_j Rᵀ + spread² along the wall."""
    xy, noise, tangents = reference.xy, reference.noise, reference.tangents
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(len(moved)):
        j = pairs[i]
        if j < 0:
            continue
        errors[i, 0], errors[i, 1] = xy[j, 0] - moved[i, 0], xy[j, 1] - moved[i, 1]
        xx, xy_, yy = rotated(point_noise[i, 0], point_noise[i, 1], point_noise[i, 2], c, s)
        spread2 = reference.spreads[j] ** 2
        xx += noise[j, 0] + spread2 * tangents[j, 0] ** 2
        xy_ += noise[j, 1] + spread2 * tangents[j, 0] * tangents[j, 1]
        yy += noise[j, 2] + spread2 * tangents[j, 1] ** 2
        determinant = xx * yy - xy_ * xy_
        weights[i, 0], weights[i, 1], weights[i, 2] = yy / determinant, -xy_ / determinant, xx / determinant


@compiled
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
    limit = _smallest(squares.copy(), last)
    count = 0
    for i in range(n):
        if pairs[i] >= 0 and squares[i] <= limit:
            ex, ey = errors[i]
            m2 = weights[i, 0] * ex * ex + 2.0 * weights[i, 1] * ex * ey + weights[i, 2] * ey * ey
            kept[i] = m2 <= gate * gate
            count += kept[i]
    return count


@compiled
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


@compiled
def _information(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Block-diagonal information about the midpoint, moved to the origin of the frame."""
    a, b, d, mx, my, turn = sums
    x, y = b * mx - a * my, d * mx - b * my  # a turn θ about the origin shifts the midpoint m by θ (−m_y, m_x)
    return np.array([[a, b, x], [b, d, y], [x, y, turn + mx * y - my * x]])


@compiled
def _statistics(errors: NDArray[np.float64], kept: NDArray[np.bool_], iterations: int) -> NDArray[np.float64]:
    count, total = 0, 0.0
    for i in range(len(kept)):
        if kept[i]:
            count += 1
            total += errors[i, 0] ** 2 + errors[i, 1] ** 2
    return np.array([float(count), total / max(count, 1), float(iterations)])
