"""Compiled loops of the joint refinement: pieces of wall that scans share, and their lines.

A *piece* of wall is a group of points of any scans that lie near one line and face the same way.
"""

from math import atan2, cos, floor, hypot, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph.compiled import compiled

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_SLOTS = 4
"""Surfels of one cell, by facing."""
_FIRST_PLACES = 1 << 15
"""Of the hash table of surfels."""


class LineFit(NamedTuple):
    """How the line of a piece of wall is fitted.

    Attributes:
        scale: width of the Cauchy weight of a typical point [m].
        rounds: of weighing anew.
        elongation: a piece so many times as long as thick has a direction of its own …
        facing: … if that lies so near its points' normals (cosine); else they give it.
    """

    scale: float
    rounds: int
    elongation: float
    facing: float


class Points(NamedTuple):
    """What scans saw, in the frames of their robots or in that of the map.

    Attributes:
        points: (n, 2) [m].
        normals: (n, 2) of the surfaces they lie on; 0, 0 where unknown.
        errors: (n, 2) standard deviations along their beams, beyond what the settings allow for [m].
    """

    points: F64
    normals: F64
    errors: F64


@compiled
def place(T_map_scans: F64, starts: I64, seen: Points, placed: Points) -> None:
    """Move what scans saw into the map; scan k has the points from starts[k] to starts[k + 1]."""
    for k in range(len(T_map_scans)):
        x, y = T_map_scans[k, 0], T_map_scans[k, 1]
        c, s = cos(T_map_scans[k, 2]), sin(T_map_scans[k, 2])
        for i in range(starts[k], starts[k + 1]):
            placed.points[i, 0] = x + c * seen.points[i, 0] - s * seen.points[i, 1]
            placed.points[i, 1] = y + s * seen.points[i, 0] + c * seen.points[i, 1]
            placed.normals[i, 0] = c * seen.normals[i, 0] - s * seen.normals[i, 1]
            placed.normals[i, 1] = s * seen.normals[i, 0] + c * seen.normals[i, 1]
            placed.errors[i, 0] = c * seen.errors[i, 0] - s * seen.errors[i, 1]
            placed.errors[i, 1] = s * seen.errors[i, 0] + c * seen.errors[i, 1]


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
def _enlarged(keys: I64, surfel_at: I64, sums: F64) -> tuple[I64, I64, F64]:
    """The same hash table with four times as many places, and with room for as many more surfels."""
    more_keys, more_at = np.full(4 * len(keys), -1), np.empty(4 * len(keys), np.int64)
    for spot in range(len(keys)):
        if keys[spot] != -1:
            other = _find(more_keys, keys[spot])
            more_keys[other], more_at[other] = keys[spot], surfel_at[spot]
    more_sums = np.empty((4 * len(sums), 5))
    for k in range(len(sums)):
        for a in range(5):
            more_sums[k, a] = sums[k, a]
    return more_keys, more_at, more_sums


@compiled
def surfels(placed: F64, turned: F64, cell: float, facing: float, member: I64) -> tuple[F64, I64, I64]:
    """Average the points of one cell that face the same way.

    Args:
        placed: (n, 2) points.
        turned: (n, 2) their normals; those without are left out.
        cell: width of a cell [m].
        facing: least cosine between the normal of a point and the mean one of those that it is averaged with.
        member: (n,) output, surfel of each point, -1 for none.

    Returns:
        (m, 5) mean x, y in cells, mean unit normal, number of points; hash table of cells and slots, a power of two
        places, -1 where free; the surfel of each place in it.
    """
    n = len(placed)
    x0, y0 = np.inf, np.inf
    for i in range(n):
        x0, y0 = min(x0, placed[i, 0]), min(y0, placed[i, 1])
    x0, y0 = x0 - 100.0, y0 - 100.0
    keys, surfel_at = np.full(_FIRST_PLACES, -1), np.empty(_FIRST_PLACES, np.int64)
    sums = np.empty((_FIRST_PLACES // 2, 5))
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
                if count == len(sums):
                    keys, surfel_at, sums = _enlarged(keys, surfel_at, sums)
                    spot = _find(keys, key)
                keys[spot] = key
                surfel_at[spot] = count
                for a in range(5):
                    sums[count, a] = 0.0
                count += 1
            k = surfel_at[spot]
            if sums[k, 2] * turned[i, 0] + sums[k, 3] * turned[i, 1] < facing * sums[k, 4]:
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
    return sums[:count], keys, surfel_at


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
    placed: Points, spreads: F64, piece_of: I64, fit: LineFit, lines: F64, residuals: F64, weights: F64
) -> tuple[float, float]:
    """Fit a line to each piece by total least squares with Cauchy weights, and see how the points lie on them.

    Args:
        placed: the points in the map.
        spreads: (n,) variance of each in that of a typical point.
        piece_of: (n,) piece of each point, -1 for none.
        fit: how.
        lines: (m, 4) output, a point and the unit normal of each.
        residuals: (n,) output, distance of each point from its line [m].
        weights: (n,) output, Cauchy weights over the spreads, 0 without a piece.

    Returns:
        Sum of the Cauchy weights, and sum of the weighted squared residuals [m²].
    """
    points = placed.points
    anchors, moments = np.zeros((len(lines), 2)), np.zeros((len(lines), 8))
    for i in range(len(points)):
        residuals[i], weights[i] = 0.0, 0.0
        g = piece_of[i]
        if g < 0:
            continue
        weights[i] = 1.0 / spreads[i]
        if moments[g, 0] == 0.0:
            assign(anchors[g], points[i])
        _add_moments(moments[g], weights[i], placed, i, anchors[g])
    total, squares = 0.0, 0.0
    inverse2 = 1.0 / (fit.scale * fit.scale)
    for left in range(fit.rounds - 1, -1, -1):
        for g in range(len(lines)):
            _line(moments[g], anchors[g], fit, lines[g])
        moments[:] = 0.0
        total, squares = 0.0, 0.0
        for i in range(len(points)):
            g = piece_of[i]
            if g < 0:
                continue
            r = lines[g, 2] * (points[i, 0] - lines[g, 0]) + lines[g, 3] * (points[i, 1] - lines[g, 1])
            w = 1.0 / (spreads[i] + r * r * inverse2)
            residuals[i], weights[i] = r, w
            total += w * spreads[i]
            squares += w * r * r
            if left > 0:
                _add_moments(moments[g], w, placed, i, anchors[g])
    return total, squares


@compiled
def _add_moments(m: F64, w: float, placed: Points, i: int, anchor: F64) -> None:
    """Add a weighed point to the sums of 1, x, y, normal, xx, xy, yy of its piece, x and y from its anchor.

    The error of a point along its beam is taken out of the second moments: on a wall that is seen from the side it
    moves points along the wall and across it at once, and would turn the line towards the beams.
    """
    x, y = placed.points[i, 0] - anchor[0], placed.points[i, 1] - anchor[1]
    ex, ey = placed.errors[i, 0], placed.errors[i, 1]
    m[0] += w
    m[1] += w * x
    m[2] += w * y
    m[3] += w * placed.normals[i, 0]
    m[4] += w * placed.normals[i, 1]
    m[5] += w * (x * x - ex * ex)
    m[6] += w * (x * y - ex * ey)
    m[7] += w * (y * y - ey * ey)


@compiled
def _line(m: F64, anchor: F64, fit: LineFit, line: F64) -> None:
    """Mean point and unit normal of a piece from the sums of its points."""
    x, y = m[1] / m[0], m[2] / m[0]
    xx, xy, yy = m[5] - m[1] * x, m[6] - m[1] * y, m[7] - m[2] * y
    mx, my = m[3], m[4]
    heading = 0.5 * atan2(2.0 * xy, xx - yy)
    nx, ny = -sin(heading), cos(heading)
    if nx * mx + ny * my < 0.0:
        nx, ny = -nx, -ny
    norm = hypot(mx, my)
    apart = xx - yy
    root = sqrt(0.25 * (apart * apart) + xy * xy)
    long, short = 0.5 * (xx + yy) + root, 0.5 * (xx + yy) - root
    if long < fit.elongation * fit.elongation * short or nx * mx + ny * my < fit.facing * norm:
        nx, ny = mx / max(norm, 1e-12), my / max(norm, 1e-12)
    line[0], line[1], line[2], line[3] = anchor[0] + x, anchor[1] + y, nx, ny
