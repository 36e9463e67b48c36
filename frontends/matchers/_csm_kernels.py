"""Correlative scan matching, compiled: likelihood table, max-pooled pyramid, branch and bound, score volume."""

import math

import numpy as np
from numpy.typing import NDArray

from graph._dense_kernels import _solve_one
from graph.compiled import compiled, compiled_for_both

FULL = 255
"""Value of the table where a reference point lies; 0 stands for `reach` away from any and farther."""


@compiled
def render_table(
    points: NDArray[np.float64], origin: NDArray[np.float64], cell: float, reach: float, table: NDArray[np.uint8]
) -> None:
    """Log-likelihood of a beam ending in each cell: FULL·(1 − d²/reach²), d to the nearest reference point.

    Of the points of one cell the first stands for all.
    """
    rows, columns = table.shape
    taken = np.zeros((rows, columns), np.bool_)
    radius = math.ceil(reach / cell)
    for k in range(len(points)):
        px, py = (points[k, 0] - origin[0]) / cell, (points[k, 1] - origin[1]) / cell
        column, row = math.floor(px), math.floor(py)
        if row < 0 or column < 0 or row >= rows or column >= columns or taken[row, column]:
            continue
        taken[row, column] = True
        for i in range(max(0, row - radius), min(rows, row + radius + 1)):
            dy = (i + 0.5 - py) * cell
            for j in range(max(0, column - radius), min(columns, column + radius + 1)):
                dx = (j + 0.5 - px) * cell
                value = int(FULL * (1.0 - (dx * dx + dy * dy) / (reach * reach)) + 0.5)
                table[i, j] = max(table[i, j], value)


@compiled
def contours(points: NDArray[np.float64], link: float, spacing: float) -> NDArray[np.float64]:
    """The points in order, and more between neighbours nearer than `link`, `spacing` apart."""
    total = len(points)
    for k in range(len(points) - 1):
        gap = math.hypot(points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1])
        if spacing < gap < link:
            total += int(gap / spacing)
    filled = np.empty((total, 2))
    n = 0
    for k in range(len(points)):
        filled[n] = points[k]
        n += 1
        if k == len(points) - 1:
            break
        dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        gap = math.hypot(dx, dy)
        if spacing < gap < link:
            pieces = int(gap / spacing)
            for piece in range(1, pieces + 1):
                share = piece / (pieces + 1)
                filled[n, 0], filled[n, 1] = points[k, 0] + share * dx, points[k, 1] + share * dy
                n += 1
    return filled


@compiled
def halve(table: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Largest value of each block of 2 by 2."""
    rows, columns = (table.shape[0] + 1) // 2, (table.shape[1] + 1) // 2
    half = np.zeros((rows, columns), np.uint8)
    for i in range(table.shape[0]):
        for j in range(table.shape[1]):
            half[i // 2, j // 2] = max(half[i // 2, j // 2], table[i, j])
    return half


@compiled
def cover(blocks: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Largest value of each block and its right, upper and upper right neighbour.

    With blocks of 2^h cells, entry (r >> h, c >> h) bounds the table over the 2^h by 2^h cells from (r, c) on, wherever
    in its block (r, c) lies. One row and column are added below and to the left, for what starts outside.
    """
    rows, columns = blocks.shape
    covered = np.zeros((rows + 1, columns + 1), np.uint8)
    for i in range(rows):
        for j in range(columns):
            value = blocks[i, j]
            for r in range(i, i + 2):
                for c in range(j, j + 2):
                    covered[r, c] = max(covered[r, c], value)
    return covered


@compiled
def turned_cells(
    points: NDArray[np.float64],
    guess: NDArray[np.float64],
    turns: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
) -> NDArray[np.int32]:
    """(n_turns, n, 2) row and column of each point at the guess turned by each angle."""
    cells = np.empty((len(turns), len(points), 2), np.int32)
    for t in range(len(turns)):
        c, s = math.cos(guess[2] + turns[t]), math.sin(guess[2] + turns[t])
        for k in range(len(points)):
            x = guess[0] + c * points[k, 0] - s * points[k, 1]
            y = guess[1] + s * points[k, 0] + c * points[k, 1]
            cells[t, k, 0] = math.floor((y - origin[1]) / cell)
            cells[t, k, 1] = math.floor((x - origin[0]) / cell)
    return cells


@compiled
def _sum_at(cells: NDArray[np.int32], dr: int, dc: int, table: NDArray[np.uint8]) -> int:
    rows, columns = table.shape
    total = 0
    for k in range(len(cells)):
        row, column = cells[k, 0] + dr, cells[k, 1] + dc
        if 0 <= row < rows and 0 <= column < columns:
            total += table[row, column]
    return total


@compiled
def exhaustive(cells: NDArray[np.int32], span: int, table: NDArray[np.uint8]) -> tuple[int, int, int, int]:
    """Best sum over all turns and offsets in cells, and where: sum, turn, row offset, column offset."""
    best, best_turn, best_dr, best_dc = -1, 0, 0, 0
    for turn in range(len(cells)):
        for dr in range(-span, span + 1):
            for dc in range(-span, span + 1):
                total = _sum_at(cells[turn], dr, dc, table)
                if total > best:
                    best, best_turn, best_dr, best_dc = total, turn, dr, dc
    return best, best_turn, best_dr, best_dc


@compiled
def _bound_at(
    cells: NDArray[np.int32], dr: int, dc: int, pyramid: NDArray[np.uint8], layout: NDArray[np.int64], height: int
) -> int:
    """Sum over a level: no sum of the table over the 2^height by 2^height offsets from here on exceeds it."""
    start, rows, columns = layout[height - 1]
    total = 0
    for k in range(len(cells)):
        row, column = ((cells[k, 0] + dr) >> height) + 1, ((cells[k, 1] + dc) >> height) + 1
        if 0 <= row < rows and 0 <= column < columns:
            total += pyramid[start + row * columns + column]
    return total


@compiled
def branch_and_bound(
    cells: NDArray[np.int32],
    span: int,
    table: NDArray[np.uint8],
    pyramid: NDArray[np.uint8],
    layout: NDArray[np.int64],
    least: int,
) -> tuple[int, int, int, int, int]:
    """The same as `exhaustive`, without looking where the pyramid's bounds say that nothing better can be.

    Depth first, the most promising branch first; a node stands for 2^h by 2^h offsets of one turn.

    Args:
        cells: (n_turns, n, 2) from `turned_cells`.
        span: largest offset in cells.
        table: the likelihood table.
        pyramid: all levels one after the other; level h is `cover` of the table's blocks of 2^h cells, h from 1.
        layout: (levels, 3) where each begins, its rows and columns.
        least: sums up to this are not worth finding.

    Returns:
        Sum (`least` if nothing exceeds it), turn, row offset, column offset and the number of nodes scored.
    """
    top = len(layout)
    bounds, roots = _roots(cells, span, table, pyramid, layout)
    scored = len(roots)
    order = np.argsort(-bounds, kind="mergesort")
    best, best_turn, best_dr, best_dc = least, -1, 0, 0
    stack = np.empty((4 * (top + 1), 4), np.int64)
    for root in order:
        if bounds[root] <= best:
            break
        turn = roots[root, 0]
        stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = bounds[root], roots[root, 1], roots[root, 2], top
        depth = 1
        while depth > 0:
            depth -= 1
            bound, dr, dc, height = stack[depth]
            if bound <= best:
                continue
            if height == 0:
                best, best_turn, best_dr, best_dc = bound, turn, dr, dc
                continue
            children = _branch(cells[turn], dr, dc, height - 1, span, table, pyramid, layout, stack[depth:])
            scored += children
            depth += children
    return best, best_turn, best_dr, best_dc, scored


@compiled
def _node_bound(
    cells: NDArray[np.int32],
    dr: int,
    dc: int,
    height: int,
    table: NDArray[np.uint8],
    pyramid: NDArray[np.uint8],
    layout: NDArray[np.int64],
) -> int:
    """Bound of a node of 2^height by 2^height offsets, the sum itself for a single one."""
    if height == 0:
        return _sum_at(cells, dr, dc, table)
    return _bound_at(cells, dr, dc, pyramid, layout, height)


@compiled
def _roots(
    cells: NDArray[np.int32],
    span: int,
    table: NDArray[np.uint8],
    pyramid: NDArray[np.uint8],
    layout: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The largest nodes, which together cover the window: (n,) bounds, and (n, 3) turn, row and column offset."""
    top = len(layout)
    width = 1 << top
    per_side = (2 * span) // width + 1
    count = len(cells) * per_side * per_side
    bounds, roots = np.empty(count, np.int64), np.empty((count, 3), np.int32)
    n = 0
    for turn in range(len(cells)):
        for a in range(per_side):
            for b in range(per_side):
                dr, dc = -span + a * width, -span + b * width
                roots[n, 0], roots[n, 1], roots[n, 2] = turn, dr, dc
                bounds[n] = _node_bound(cells[turn], dr, dc, top, table, pyramid, layout)
                n += 1
    return bounds, roots


@compiled
def _branch(
    cells: NDArray[np.int32],
    dr: int,
    dc: int,
    height: int,
    span: int,
    table: NDArray[np.uint8],
    pyramid: NDArray[np.uint8],
    layout: NDArray[np.int64],
    stack: NDArray[np.int64],
) -> int:
    """Put the children of a node, of this height, on the stack, the most promising last; return how many."""
    half = 1 << height
    count = 0
    for r in (dr, dr + half):
        for c in (dc, dc + half):
            if r > span or c > span:
                continue
            bound = _node_bound(cells, r, c, height, table, pyramid, layout)
            at = count
            while at > 0 and stack[at - 1, 0] > bound:
                stack[at] = stack[at - 1]
                at -= 1
            stack[at, 0], stack[at, 1], stack[at, 2], stack[at, 3] = bound, r, c, height
            count += 1
    return count


@compiled
def _smooth(table: NDArray[np.uint8], x: float, y: float) -> tuple[float, float, float]:
    """Bilinear value in [0, 1] and its derivatives per cell at a place in cells, cell centres at half numbers."""
    column, row = math.floor(x - 0.5), math.floor(y - 0.5)
    if row < 0 or column < 0 or row >= table.shape[0] - 1 or column >= table.shape[1] - 1:
        return 0.0, 0.0, 0.0
    u, v = x - 0.5 - column, y - 0.5 - row
    a, b = float(table[row, column]), float(table[row, column + 1])
    c, d = float(table[row + 1, column]), float(table[row + 1, column + 1])
    value = (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v
    return value / FULL, ((b - a) * (1.0 - v) + (d - c) * v) / FULL, ((c - a) * (1.0 - u) + (d - b) * u) / FULL


@compiled_for_both
def mean_value(
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    table: NDArray[np.uint8],
    origin: NDArray[np.float64],
    cell: float,
    stride: int,
) -> float:
    """Mean of the interpolated table over every `stride`-th point, in [0, 1]."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total, n = 0.0, 0
    for k in range(0, len(points), stride):
        x = (pose[0] + c * points[k, 0] - s * points[k, 1] - origin[0]) / cell
        y = (pose[1] + s * points[k, 0] + c * points[k, 1] - origin[1]) / cell
        total += _smooth(table, x, y)[0]
        n += 1
    return total / max(n, 1)


@compiled
def count_values(
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    table: NDArray[np.uint8],
    origin: NDArray[np.float64],
    cell: float,
    least: float,
) -> tuple[int, int]:
    """How many points find a value of `least` or more, and how many any at all."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    high, some = 0, 0
    for k in range(len(points)):
        x = (pose[0] + c * points[k, 0] - s * points[k, 1] - origin[0]) / cell
        y = (pose[1] + s * points[k, 0] + c * points[k, 1] - origin[1]) / cell
        value = _smooth(table, x, y)[0]
        high += value >= least
        some += value > 0.0
    return high, some


@compiled
def polish(
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    table: NDArray[np.uint8],
    origin: NDArray[np.float64],
    cell: float,
    iterations: int,
) -> NDArray[np.float64]:
    """Gauss-Newton on Σ (1 − value) over the interpolated table; a step that does not help ends it.

    1 − value is the squared distance to the reference, so its root is the residual.
    """
    pose = start.copy()
    cost = math.inf
    normal, right, step = np.empty((3, 3)), np.empty(3), np.empty(3)
    previous = pose.copy()
    for _ in range(iterations):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        normal[:], right[:] = 0.0, 0.0
        here = 0.0
        for k in range(len(points)):
            rx, ry = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
            value, gx, gy = _smooth(table, (pose[0] + rx - origin[0]) / cell, (pose[1] + ry - origin[1]) / cell)
            here += 1.0 - value
            if value <= 0.0:
                continue
            jx, jy = gx / cell, gy / cell
            jt = jy * rx - jx * ry
            weight = 0.25 / max(1.0 - value, 0.01)
            normal[0, 0] += weight * jx * jx
            normal[0, 1] += weight * jx * jy
            normal[0, 2] += weight * jx * jt
            normal[1, 1] += weight * jy * jy
            normal[1, 2] += weight * jy * jt
            normal[2, 2] += weight * jt * jt
            right[0] += 0.5 * jx
            right[1] += 0.5 * jy
            right[2] += 0.5 * jt
        if here >= cost:
            return previous
        cost = here
        previous[:] = pose
        normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
        for i in range(3):
            normal[i, i] = 1.02 * normal[i, i] + 1e-3
        _solve_one(normal, right, step)
        pose += step
        if abs(step[0]) + abs(step[1]) + abs(step[2]) < 1e-5:
            break
    if mean_value(points, pose, table, origin, cell, 1) < mean_value(points, previous, table, origin, cell, 1):
        return previous
    return pose


@compiled
def score_volume(
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    axes: NDArray[np.float64],
    steps: NDArray[np.float64],
    half: int,
    table: NDArray[np.uint8],
    origin: NDArray[np.float64],
    cell: float,
    stride: int,
    volume: NDArray[np.float64],
) -> None:
    """Mean values on a grid of poses around `pose`: offset Σ kᵢ·stepsᵢ·axes[:, i] in the robot's axes, |kᵢ| ≤ half."""
    moved = np.empty(3)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            for k in range(-half, half + 1):
                dx = i * steps[0] * axes[0, 0] + j * steps[1] * axes[0, 1] + k * steps[2] * axes[0, 2]
                dy = i * steps[0] * axes[1, 0] + j * steps[1] * axes[1, 1] + k * steps[2] * axes[1, 2]
                dt = i * steps[0] * axes[2, 0] + j * steps[1] * axes[2, 1] + k * steps[2] * axes[2, 2]
                moved[0] = pose[0] + c * dx - s * dy
                moved[1] = pose[1] + s * dx + c * dy
                moved[2] = pose[2] + dt
                volume[i + half, j + half, k + half] = mean_value(points, moved, table, origin, cell, stride)
