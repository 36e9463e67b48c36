"""Compiled loops of the joint refinement: pieces of wall that scans share, their lines, and the normal equations.

A *piece* of wall is a group of points of any scans that lie near one line and face the same way. Its line (offset and
direction) is an unknown beside the poses; it is eliminated, so that the system that remains is one of poses alone.
"""

from math import atan2, cos, floor, hypot, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_SLOTS = 4
"""Surfels of one cell, by facing."""
_SAME_FACING = 0.8
_FIRST_PLACES = 1 << 15
"""Of the hash table of surfels."""
_ELONGATED = 16.0
"""A piece has a direction of its own when its extent is this many times its thickness, squared …"""
_BESIDE = 0.9
"""… and that lies near its points' normals (cosine); else they give it."""
_LOOSE = 1e-3
"""Weight of a prior on a line, in points: few points alone would leave it undetermined."""
_PRIOR_LENGTH = 0.05


@compiled
def place(T_map_scans: F64, starts: I64, points: F64, normals: F64, placed: F64, turned: F64) -> None:
    """Move points (n, 2) and normals of scans into the map; scan k has those from starts[k] to starts[k + 1]."""
    for k in range(len(T_map_scans)):
        x, y = T_map_scans[k, 0], T_map_scans[k, 1]
        c, s = cos(T_map_scans[k, 2]), sin(T_map_scans[k, 2])
        for i in range(starts[k], starts[k + 1]):
            placed[i, 0] = x + c * points[i, 0] - s * points[i, 1]
            placed[i, 1] = y + s * points[i, 0] + c * points[i, 1]
            turned[i, 0] = c * normals[i, 0] - s * normals[i, 1]
            turned[i, 1] = s * normals[i, 0] + c * normals[i, 1]


@compiled
def _find(keys: I64, key: int) -> int:
    """Place of a key in an open hash table of a power of two places, or the free place where it belongs."""
    mask = len(keys) - 1
    spot = (key * 7046029254386353131 >> 20) & mask
    while keys[spot] != -1 and keys[spot] != key:
        spot = (spot + 1) & mask
    return spot


@compiled
def _key(u: int, v: int, slot: int) -> int:
    return ((u << 24) + v) * _SLOTS + slot


@compiled
def _enlarged(keys: I64, surfel_at: I64) -> tuple[I64, I64]:
    """The same hash table with four times as many places."""
    more_keys, more_at = np.full(4 * len(keys), -1), np.empty(4 * len(keys), np.int64)
    for spot in range(len(keys)):
        if keys[spot] != -1:
            other = _find(more_keys, keys[spot])
            more_keys[other], more_at[other] = keys[spot], surfel_at[spot]
    return more_keys, more_at


@compiled
def surfels(placed: F64, turned: F64, cell: float, member: I64) -> tuple[F64, I64, I64]:
    """Average the points of one cell that face the same way.

    Args:
        placed: (n, 2) points.
        turned: (n, 2) their normals; those without are left out.
        cell: width of a cell [m].
        member: (n,) output, surfel of each point, -1 for none.

    Returns:
        (m, 5) mean x, y in cells, mean unit normal, number of points; hash table of cells and slots, a power of two
        places, -1 where free; the surfel of each place in it.
    """
    n = len(placed)
    x0, y0 = placed[:, 0].min() - 100.0, placed[:, 1].min() - 100.0
    keys, surfel_at = np.full(_FIRST_PLACES, -1), np.empty(_FIRST_PLACES, np.int64)
    sums = np.zeros((n, 5))
    count = 0
    for i in range(n):
        member[i] = -1
        if turned[i, 0] == 0.0 and turned[i, 1] == 0.0:
            continue
        u, v = floor((placed[i, 0] - x0) / cell), floor((placed[i, 1] - y0) / cell)
        for slot in range(_SLOTS):
            key = _key(u, v, slot)
            spot = _find(keys, key)
            if keys[spot] == -1:
                if 3 * count > len(keys):
                    keys, surfel_at = _enlarged(keys, surfel_at)
                    spot = _find(keys, key)
                keys[spot] = key
                surfel_at[spot] = count
                count += 1
            k = surfel_at[spot]
            if sums[k, 2] * turned[i, 0] + sums[k, 3] * turned[i, 1] < _SAME_FACING * sums[k, 4]:
                continue
            sums[k, 0] += placed[i, 0]
            sums[k, 1] += placed[i, 1]
            sums[k, 2] += turned[i, 0]
            sums[k, 3] += turned[i, 1]
            sums[k, 4] += 1.0
            member[i] = k
            break
    for k in range(count):
        norm = hypot(sums[k, 2], sums[k, 3])
        sums[k, 0] = (sums[k, 0] / sums[k, 4] - x0) / cell
        sums[k, 1] = (sums[k, 1] / sums[k, 4] - y0) / cell
        sums[k, 2] /= norm
        sums[k, 3] /= norm
    return sums[:count].copy(), keys, surfel_at


@compiled
def group(
    surfels: F64,
    order: I64,
    cell: float,
    along: float,
    across: float,
    facing: float,
    keys: I64,
    surfel_at: I64,
    piece: I64,
) -> int:
    """Group surfels into pieces of wall: around the first all others near its line, then around the next one left.

    Args:
        surfels: (m, 5) of `surfels`.
        order: (m,) in which they begin pieces.
        cell: width of a surfel [m].
        along: half the length of a piece [m].
        across: largest distance from the line of its first surfel [m]: how far passes over one place may lie apart.
        facing: least cosine between the normals of two surfels of one piece.
        keys: hash table of `surfels` …
        surfel_at: … and the surfel of each place in it.
        piece: (m,) output.

    Returns:
        The number of pieces.
    """
    piece[:] = -1
    span = int(max(along, across) / cell) + 1
    pieces = 0
    for first in order:
        if piece[first] >= 0:
            continue
        x, y, nx, ny = surfels[first, 0], surfels[first, 1], surfels[first, 2], surfels[first, 3]
        u, v = floor(x), floor(y)
        for a in range(u - span, u + span + 1):
            for b in range(v - span, v + span + 1):
                for slot in range(_SLOTS):
                    spot = _find(keys, _key(a, b, slot))
                    if keys[spot] == -1:
                        break
                    k = surfel_at[spot]
                    if piece[k] >= 0 or nx * surfels[k, 2] + ny * surfels[k, 3] < facing:
                        continue
                    dx, dy = cell * (surfels[k, 0] - x), cell * (surfels[k, 1] - y)
                    if abs(nx * dx + ny * dy) < across and abs(nx * dy - ny * dx) < along:
                        piece[k] = pieces
        piece[first] = pieces
        pieces += 1
    return pieces


@compiled
def fit_lines(
    placed: F64,
    turned: F64,
    piece_of: I64,
    scale: float,
    rounds: int,
    lines: F64,
    residuals: F64,
    weights: F64,
) -> tuple[float, float]:
    """Fit a line to each piece by total least squares with Cauchy weights, and see how the points lie on them.

    Args:
        placed: (n, 2) points in the map [m].
        turned: (n, 2) their normals.
        piece_of: (n,) piece of each point, -1 for none.
        scale: width of the Cauchy weight [m].
        rounds: of weighing anew.
        lines: (m, 4) output, a point and the unit normal of each.
        residuals: (n,) output, distance of each point from its line [m].
        weights: (n,) output, Cauchy weights, 0 without a piece.

    Returns:
        Sum of the weights, and sum of the weighted squared residuals [m²].
    """
    anchors, moments = np.zeros((len(lines), 2)), np.zeros((len(lines), 8))
    for i in range(len(placed)):
        residuals[i], weights[i] = 0.0, 0.0
        g = piece_of[i]
        if g < 0:
            continue
        weights[i] = 1.0
        if moments[g, 0] == 0.0:
            anchors[g] = placed[i]
        _add_moments(moments[g], 1.0, placed[i], turned[i], anchors[g])
    total, squares = 0.0, 0.0
    inverse2 = 1.0 / (scale * scale)
    for left in range(rounds - 1, -1, -1):
        for g in range(len(lines)):
            _line(moments[g], anchors[g], lines[g])
        moments[:] = 0.0
        total, squares = 0.0, 0.0
        for i in range(len(placed)):
            g = piece_of[i]
            if g < 0:
                continue
            r = lines[g, 2] * (placed[i, 0] - lines[g, 0]) + lines[g, 3] * (placed[i, 1] - lines[g, 1])
            w = 1.0 / (1.0 + r * r * inverse2)
            residuals[i], weights[i] = r, w
            total += w
            squares += w * r * r
            if left > 0:
                _add_moments(moments[g], w, placed[i], turned[i], anchors[g])
    return total, squares


@compiled
def _add_moments(m: F64, w: float, point: F64, normal: F64, anchor: F64) -> None:
    """Add a weighed point to the sums of 1, x, y, normal, xx, xy, yy of its piece, x and y from its anchor."""
    x, y = point[0] - anchor[0], point[1] - anchor[1]
    m[0] += w
    m[1] += w * x
    m[2] += w * y
    m[3] += w * normal[0]
    m[4] += w * normal[1]
    m[5] += w * x * x
    m[6] += w * x * y
    m[7] += w * y * y


@compiled
def _line(m: F64, anchor: F64, line: F64) -> None:
    """Mean point and unit normal of a piece from the sums of its points."""
    x, y = m[1] / m[0], m[2] / m[0]
    xx, xy, yy = m[5] - m[1] * x, m[6] - m[1] * y, m[7] - m[2] * y
    mx, my = m[3], m[4]
    heading = 0.5 * atan2(2.0 * xy, xx - yy)
    nx, ny = -sin(heading), cos(heading)
    if nx * mx + ny * my < 0.0:
        nx, ny = -nx, -ny
    norm = hypot(mx, my)
    root = sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    long, short = 0.5 * (xx + yy) + root, 0.5 * (xx + yy) - root
    if long < _ELONGATED * short or nx * mx + ny * my < _BESIDE * norm:
        nx, ny = mx / max(norm, 1e-12), my / max(norm, 1e-12)
    line[0], line[1], line[2], line[3] = anchor[0] + x, anchor[1] + y, nx, ny


@compiled
def normal_equations(
    poses: F64,
    starts: I64,
    placed: F64,
    piece_of: I64,
    lines: F64,
    residuals: F64,
    weights: F64,
    diagonal: F64,
    gradient: F64,
    pose_of: I64,
    line_of: I64,
    blocks: F64,
) -> int:
    """½ Σ w r² linearised in the poses, the lines eliminated: H = diagonal − B Bᵀ, and its gradient.

    Args:
        poses: (k, 3) T_map_robot.
        starts: (k + 1,) first point of each pose.
        placed: (n, 2) points in the map [m].
        piece_of: (n,) piece of each point, -1 for none.
        lines: (m, 4) of the pieces.
        residuals: (n,) [m].
        weights: (n,).
        diagonal: (k, 3, 3) zeros; output, tangent space at each pose.
        gradient: (k, 3) zeros; output.
        pose_of: (n,) output: pose of each block of B, increasing …
        line_of: (n,) output: … and its line.
        blocks: (n, 3, 2) output: the blocks.

    Returns:
        The number of blocks.
    """
    m = len(lines)
    hll, gl = np.zeros((m, 3)), np.zeros((m, 2))
    last = np.full(m, -1)
    count = 0
    for k in range(len(poses)):
        first = count
        c, s = cos(poses[k, 2]), sin(poses[k, 2])
        for i in range(starts[k], starts[k + 1]):
            g = piece_of[i]
            if g < 0:
                continue
            q = last[g]
            if q < first:
                q = count
                last[g] = q
                pose_of[q], line_of[q] = k, g
                blocks[q] = 0.0
                count += 1
            w, r = weights[i], residuals[i]
            # Derivatives with respect to a step of the robot in its own frame, and of the line: offset and turn.
            jx, jy = c * lines[g, 2] + s * lines[g, 3], c * lines[g, 3] - s * lines[g, 2]
            jt = lines[g, 3] * (placed[i, 0] - poses[k, 0]) - lines[g, 2] * (placed[i, 1] - poses[k, 1])
            t = lines[g, 2] * (placed[i, 1] - lines[g, 1]) - lines[g, 3] * (placed[i, 0] - lines[g, 0])
            diagonal[k, 0, 0] += w * jx * jx
            diagonal[k, 0, 1] += w * jx * jy
            diagonal[k, 0, 2] += w * jx * jt
            diagonal[k, 1, 1] += w * jy * jy
            diagonal[k, 1, 2] += w * jy * jt
            diagonal[k, 2, 2] += w * jt * jt
            gradient[k, 0] += w * r * jx
            gradient[k, 1] += w * r * jy
            gradient[k, 2] += w * r * jt
            blocks[q, 0, 0] -= w * jx
            blocks[q, 1, 0] -= w * jy
            blocks[q, 2, 0] -= w * jt
            blocks[q, 0, 1] -= w * jx * t
            blocks[q, 1, 1] -= w * jy * t
            blocks[q, 2, 1] -= w * jt * t
            hll[g, 0] += w
            hll[g, 1] += w * t
            hll[g, 2] += w * t * t
            gl[g, 0] -= w * r
            gl[g, 1] -= w * r * t
    for k in range(len(poses)):
        diagonal[k, 1, 0], diagonal[k, 2, 0] = diagonal[k, 0, 1], diagonal[k, 0, 2]
        diagonal[k, 2, 1] = diagonal[k, 1, 2]
    # With L Lᵀ the Hessian of a line, B = blocks · L⁻ᵀ.
    for g in range(m):
        l00 = sqrt(hll[g, 0] + _LOOSE)
        l10 = hll[g, 1] / l00
        l11 = sqrt(hll[g, 2] + _LOOSE * _PRIOR_LENGTH**2 - l10 * l10)
        hll[g, 0], hll[g, 1], hll[g, 2] = l00, l10, l11
        gl[g, 0] /= l00
        gl[g, 1] = (gl[g, 1] - l10 * gl[g, 0]) / l11
    for q in range(count):
        k, g = pose_of[q], line_of[q]
        for a in range(3):
            blocks[q, a, 0] /= hll[g, 0]
            blocks[q, a, 1] = (blocks[q, a, 1] - hll[g, 1] * blocks[q, a, 0]) / hll[g, 2]
            gradient[k, a] -= blocks[q, a, 0] * gl[g, 0] + blocks[q, a, 1] * gl[g, 1]
    return count


@compiled
def product(diagonal: F64, pose_of: I64, line_of: I64, blocks: F64, n_lines: int, x: F64) -> F64:
    """(k, 3) H x of the system that `normal_equations` leaves."""
    y = np.empty_like(x)
    for k in range(len(x)):
        for a in range(3):
            y[k, a] = diagonal[k, a, 0] * x[k, 0] + diagonal[k, a, 1] * x[k, 1] + diagonal[k, a, 2] * x[k, 2]
    pulled = np.zeros((n_lines, 2))
    for q in range(len(pose_of)):
        k, b, p = pose_of[q], blocks[q], pulled[line_of[q]]
        p[0] += b[0, 0] * x[k, 0] + b[1, 0] * x[k, 1] + b[2, 0] * x[k, 2]
        p[1] += b[0, 1] * x[k, 0] + b[1, 1] * x[k, 1] + b[2, 1] * x[k, 2]
    for q in range(len(pose_of)):
        k, b, p = pose_of[q], blocks[q], pulled[line_of[q]]
        for a in range(3):
            y[k, a] -= b[a, 0] * p[0] + b[a, 1] * p[1]
    return y


@compiled
def fill(diagonal: F64, pose_of: I64, line_of: I64, blocks: F64, matrix: F64) -> None:
    """The same system as a (3k, 3k) matrix, zeros before; its blocks sorted by line."""
    for k in range(len(diagonal)):
        for a in range(3):
            for b in range(3):
                matrix[3 * k + a, 3 * k + b] += diagonal[k, a, b]
    first = 0
    for q in range(len(pose_of)):
        if line_of[q] != line_of[first]:
            first = q
        i = 3 * pose_of[q]
        for p in range(first, q + 1):
            j = 3 * pose_of[p]
            for a in range(3):
                for b in range(3):
                    shared = blocks[q, a, 0] * blocks[p, b, 0] + blocks[q, a, 1] * blocks[p, b, 1]
                    matrix[i + a, j + b] -= shared
                    if p != q:
                        matrix[j + b, i + a] -= shared
