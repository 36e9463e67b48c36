"""Normal distributions transform, compiled: cells of four overlapping grids, score, derivatives, Newton's method."""

import math

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both

MEAN_X, MEAN_Y, INV_XX, INV_XY, INV_YY, VALID = range(6)
"""Columns of a cell: mean [m], inverse covariance [1/m²], whether there is a distribution."""

_FARTHEST = 30.0  # squared Mahalanobis distance beyond which exp(-d²/2) is as good as zero
_HALVINGS = 6
"""How often a step that lowers the score is halved before it is given up."""


@compiled
def build_cells(
    points: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
    rows: int,
    columns: int,
    fewest: int,
    ratio: float,
) -> NDArray[np.float64]:
    """(4, rows, columns, 6) normal distributions of the points in each cell.

    The grids lie at `origin` and half a cell to the left, below, and both. The smaller eigenvalue of a covariance is
    raised to `ratio` of the larger one.
    """
    cells = np.zeros((4, rows, columns, 6))
    sums = np.zeros((rows, columns, 6))
    for grid in range(4):
        sums[:] = 0.0
        x0, y0 = origin[0] - 0.5 * cell * (grid % 2), origin[1] - 0.5 * cell * (grid // 2)
        for k in range(len(points)):
            column, row = int((points[k, 0] - x0) / cell), int((points[k, 1] - y0) / cell)
            # Relative to the cell's corner: squares of coordinates far from the origin would lose digits.
            x, y = points[k, 0] - x0 - column * cell, points[k, 1] - y0 - row * cell
            sums[row, column, 0] += 1.0
            sums[row, column, 1] += x
            sums[row, column, 2] += y
            sums[row, column, 3] += x * x
            sums[row, column, 4] += x * y
            sums[row, column, 5] += y * y
        for row in range(rows):
            for column in range(columns):
                n = sums[row, column, 0]
                if n < fewest:
                    continue
                mx, my = sums[row, column, 1] / n, sums[row, column, 2] / n
                xx = sums[row, column, 3] / n - mx * mx
                xy = sums[row, column, 4] / n - mx * my
                yy = sums[row, column, 5] / n - my * my
                half = 0.5 * (xx + yy)
                root = math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
                largest, smallest = half + root, half - root
                if largest <= 1e-9:
                    continue
                smallest = max(smallest, ratio * largest)
                c, s = 1.0, 0.0
                if root > 1e-12:
                    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
                    c, s = math.cos(angle), math.sin(angle)
                cells[grid, row, column, MEAN_X] = x0 + column * cell + mx
                cells[grid, row, column, MEAN_Y] = y0 + row * cell + my
                cells[grid, row, column, INV_XX] = c * c / largest + s * s / smallest
                cells[grid, row, column, INV_XY] = c * s * (1.0 / largest - 1.0 / smallest)
                cells[grid, row, column, INV_YY] = s * s / largest + c * c / smallest
                cells[grid, row, column, VALID] = 1.0
    return cells


@compiled
def _index(x: float, y: float, grid: int, origin: NDArray[np.float64], cell: float) -> tuple[int, int]:
    column = math.floor((x - origin[0]) / cell + 0.5 * (grid % 2))
    row = math.floor((y - origin[1]) / cell + 0.5 * (grid // 2))
    return int(row), int(column)


@compiled_for_both
def score_of(
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    cells: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
) -> float:
    """Sum of exp(-dᵀS⁻¹d/2) over points and grids."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for k in range(len(points)):
        x = pose[0] + c * points[k, 0] - s * points[k, 1]
        y = pose[1] + s * points[k, 0] + c * points[k, 1]
        for grid in range(4):
            row, column = _index(x, y, grid, origin, cell)
            if row < 0 or column < 0 or row >= cells.shape[1] or column >= cells.shape[2]:
                continue
            here = cells[grid, row, column]
            if here[VALID] == 0.0:
                continue
            dx, dy = x - here[MEAN_X], y - here[MEAN_Y]
            squared = here[INV_XX] * dx * dx + 2.0 * here[INV_XY] * dx * dy + here[INV_YY] * dy * dy
            if squared < _FARTHEST:
                total += math.exp(-0.5 * squared)
    return total


@compiled_for_both
def derivatives(
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    cells: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
    gradients: NDArray[np.float64],
    hessian: NDArray[np.float64],
) -> float:
    """Score; fills (n, 3) gradients of each point's share of the negative score, and its (3, 3) Hessian.

    Order x, y, heading of the reference frame (Biber and Straßer 2003, equations 8 to 12).
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    gradients[:] = 0.0
    hessian[:] = 0.0
    total = 0.0
    for k in range(len(points)):
        rx, ry = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        x, y = pose[0] + rx, pose[1] + ry
        for grid in range(4):
            row, column = _index(x, y, grid, origin, cell)
            if row < 0 or column < 0 or row >= cells.shape[1] or column >= cells.shape[2]:
                continue
            here = cells[grid, row, column]
            if here[VALID] == 0.0:
                continue
            xx, xy, yy = here[INV_XX], here[INV_XY], here[INV_YY]
            dx, dy = x - here[MEAN_X], y - here[MEAN_Y]
            mx, my = xx * dx + xy * dy, xy * dx + yy * dy
            squared = mx * dx + my * dy
            if squared >= _FARTHEST:
                continue
            e = math.exp(-0.5 * squared)
            total += e
            mt = my * rx - mx * ry
            gradients[k, 0] += e * mx
            gradients[k, 1] += e * my
            gradients[k, 2] += e * mt
            tx, ty = xy * rx - xx * ry, yy * rx - xy * ry
            hessian[0, 0] += e * (xx - mx * mx)
            hessian[0, 1] += e * (xy - mx * my)
            hessian[0, 2] += e * (tx - mx * mt)
            hessian[1, 1] += e * (yy - my * my)
            hessian[1, 2] += e * (ty - my * mt)
            hessian[2, 2] += e * (ty * rx - tx * ry - mt * mt - mx * rx - my * ry)
    hessian[1, 0] = hessian[0, 1]
    hessian[2, 0] = hessian[0, 2]
    hessian[2, 1] = hessian[1, 2]
    return total


@compiled
def _solve(hessian: NDArray[np.float64], gradient: NDArray[np.float64], reach2: float) -> NDArray[np.float64]:
    """Newton's step; λI is added until the Hessian is positive definite, the heading weighed by `reach2` [m²]."""
    lower = np.empty((3, 3))
    damping = 0.0
    largest = max(abs(hessian[0, 0]), abs(hessian[1, 1]), abs(hessian[2, 2]) / reach2, 1e-6)
    while True:
        sound = True
        for i in range(3):
            for j in range(i + 1):
                value = hessian[i, j]
                if i == j:
                    value += damping * (reach2 if i == 2 else 1.0)
                for k in range(j):
                    value -= lower[i, k] * lower[j, k]
                if i == j:
                    if value <= 1e-3 * largest * (reach2 if i == 2 else 1.0):
                        sound = False
                        break
                    lower[i, i] = math.sqrt(value)
                else:
                    lower[i, j] = value / lower[j, j]
            if not sound:
                break
        if sound:
            break
        damping = max(2.0 * damping, 0.01 * largest)
    step = np.empty(3)
    for i in range(3):
        value = -gradient[i]
        for k in range(i):
            value -= lower[i, k] * step[k]
        step[i] = value / lower[i, i]
    for i in range(2, -1, -1):
        value = step[i]
        for k in range(i + 1, 3):
            value -= lower[k, i] * step[k]
        step[i] = value / lower[i, i]
    return step


@compiled
def align(
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    cells: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
    iterations: int,
    tolerance: float,
    gradients: NDArray[np.float64],
    hessian: NDArray[np.float64],
) -> tuple[NDArray[np.float64], float, int]:
    """Newton's method on the negative score; steps that do not lower it are halved.

    Returns:
        The pose, its score and the iterations done; `gradients` and `hessian` are those at the pose.
    """
    pose = start.copy()
    reach2 = 0.0
    for k in range(len(points)):
        reach2 += points[k, 0] ** 2 + points[k, 1] ** 2
    reach2 = max(reach2 / max(len(points), 1), 1e-6)
    score = derivatives(points, pose, cells, origin, cell, gradients, hessian)
    done = 0
    trial = np.empty(3)
    gradient = np.empty(3)
    while done < iterations:
        for i in range(3):
            gradient[i] = gradients[:, i].sum()
        step = _solve(hessian, gradient, reach2)
        length = math.sqrt(step[0] ** 2 + step[1] ** 2 + reach2 * step[2] ** 2)
        if length > 0.5 * cell:
            step *= 0.5 * cell / length
            length = 0.5 * cell
        better = False
        for _ in range(_HALVINGS):
            for i in range(3):
                trial[i] = pose[i] + step[i]
            if score_of(points, trial, cells, origin, cell) > score:
                better = True
                break
            step *= 0.5
            length *= 0.5
        done += 1
        if not better:
            break
        pose[:] = trial
        score = derivatives(points, pose, cells, origin, cell, gradients, hessian)
        if length < tolerance:
            break
    pose[2] = math.atan2(math.sin(pose[2]), math.cos(pose[2]))
    return pose, score, done


@compiled
def count_inliers(
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    cells: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
    gate: float,
) -> tuple[int, int]:
    """How many points lie within the squared Mahalanobis distance `gate` of a distribution, and how many meet one."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    inliers, met = 0, 0
    for k in range(len(points)):
        x = pose[0] + c * points[k, 0] - s * points[k, 1]
        y = pose[1] + s * points[k, 0] + c * points[k, 1]
        nearest = math.inf
        for grid in range(4):
            row, column = _index(x, y, grid, origin, cell)
            if row < 0 or column < 0 or row >= cells.shape[1] or column >= cells.shape[2]:
                continue
            here = cells[grid, row, column]
            if here[VALID] == 0.0:
                continue
            dx, dy = x - here[MEAN_X], y - here[MEAN_Y]
            squared = here[INV_XX] * dx * dx + 2.0 * here[INV_XY] * dx * dy + here[INV_YY] * dy * dy
            nearest = min(nearest, squared)
        if nearest < math.inf:
            met += 1
        if nearest < gate:
            inliers += 1
    return inliers, met


@compiled
def clustered_spread(
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    gradients: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
    rows: int,
    columns: int,
) -> NDArray[np.float64]:
    """(3, 3) Σ ggᵀ over cells, g the summed gradients of a cell's points: they share the cell's error."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    sums = np.zeros((rows, columns, 3))
    for k in range(len(points)):
        x = pose[0] + c * points[k, 0] - s * points[k, 1]
        y = pose[1] + s * points[k, 0] + c * points[k, 1]
        row, column = _index(x, y, 0, origin, cell)
        row, column = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
        for i in range(3):
            sums[row, column, i] += gradients[k, i]
    spread = np.zeros((3, 3))
    for row in range(rows):
        for column in range(columns):
            for i in range(3):
                for j in range(3):
                    spread[i, j] += sums[row, column, i] * sums[row, column, j]
    return spread


@compiled
def thin_information(
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    cells: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
    thinnest: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Split of the derivatives between thin and long axes of the distributions.

    Along a wall a distribution is as long as its cell: what it says there is the grid's, not the world's.

    Returns:
        (3, 3) curvature of the negative score from axes thinner than `thinnest` [m], and (3,) its gradient from the
        others.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    information = np.zeros((3, 3))
    pull = np.zeros(3)
    limit = 1.0 / thinnest**2
    normal = np.empty(3)
    for k in range(len(points)):
        rx, ry = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        x, y = pose[0] + rx, pose[1] + ry
        for grid in range(4):
            row, column = _index(x, y, grid, origin, cell)
            if row < 0 or column < 0 or row >= cells.shape[1] or column >= cells.shape[2]:
                continue
            here = cells[grid, row, column]
            if here[VALID] == 0.0:
                continue
            xx, xy, yy = here[INV_XX], here[INV_XY], here[INV_YY]
            dx, dy = x - here[MEAN_X], y - here[MEAN_Y]
            squared = xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy
            if squared >= _FARTHEST:
                continue
            e = math.exp(-0.5 * squared)
            half = 0.5 * (xx + yy)
            root = math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
            angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
            for axis in range(2):
                inverse = half + root if axis == 0 else half - root
                nx, ny = math.cos(angle), math.sin(angle)
                if axis == 1:
                    nx, ny = -ny, nx
                normal[0], normal[1], normal[2] = nx, ny, ny * rx - nx * ry
                if inverse < limit:
                    pull += e * inverse * (nx * dx + ny * dy) * normal
                    continue
                off = inverse * (nx * dx + ny * dy) ** 2
                for i in range(3):
                    for j in range(3):
                        information[i, j] += e * inverse * (1.0 - off) * normal[i] * normal[j]
    return information, pull
