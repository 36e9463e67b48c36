"""Histograms over all pairs of features or points of a place, compiled."""

from math import atan2, cos, floor, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import ZERO, compiled

F64 = NDArray[np.float64]
I8 = NDArray[np.int8]
I64 = NDArray[np.int64]

_KINDS = 3
_MULTIPLIER = 2654435761  # Knuth's multiplicative hash


class Words(NamedTuple):
    """Which pairs of features are words.

    Attributes:
        closest: pairs closer to each other are left out [m] …
        reach: … and those farther apart [m].
        cell: width of the cells of distance [m].
        sectors: number of sectors of a full turn.
        max_hits: a feature that more scans saw counts no more than this.
    """

    closest: float
    reach: float
    cell: float
    sectors: int
    max_hits: float


@compiled
def _direction(row: F64) -> float:
    """Heading of a feature: of its wall, or halfway between its two walls."""
    a, b = row[2], row[3]
    if np.isnan(a):
        return float(b)
    if np.isnan(b):
        return float(a)
    return atan2(sin(a) + sin(b), cos(a) + cos(b))


@compiled
def _sector(angle: float, sectors: int) -> int:
    return floor(angle / (2.0 * pi) * sectors + 0.5) % sectors


@compiled
def likeness(queries: NDArray[np.float32], rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """(q, m) products of (q, d) signatures with (m, d) others, each summed in the same order."""
    products = np.zeros((len(queries), len(rows)), np.float32)
    columns = np.ascontiguousarray(rows.T)
    for q in range(len(queries)):
        for d in range(queries.shape[1]):
            factor = queries[q, d]
            if factor != 0.0:
                for m in range(len(rows)):
                    products[q, m] += factor * columns[d, m]
    return products


@compiled
def count_pairs(kinds: I8, rows: F64, hits: F64, words: Words, histogram: F64) -> None:
    """Add every pair of features to a histogram of what does not change when the whole place is turned or moved.

    A word is both kinds, the distance, and the sector in which each sees the other relative to its own walls; words are
    spread over the bins by a hash, and a distance between two cells counts in both.

    Args:
        kinds: (n,) kind of each feature.
        rows: (n, 10), see `iceg.ice.features.FeatureRows`.
        hits: (n,) in how many scans each was seen.
        words: which pairs count.
        histogram: (bins,) changed in place.
    """
    reach, cell, sectors = words.reach, words.cell, words.sectors
    n_cells, bins, base = int(reach / cell) + 2, len(histogram), _KINDS * sectors
    directions = np.empty(len(kinds))
    for i in range(len(kinds)):
        directions[i] = _direction(rows[i])
    for i in range(len(kinds)):
        for j in range(i + 1, len(kinds)):
            dx, dy = rows[j, 0] - rows[i, 0], rows[j, 1] - rows[i, 1]
            if abs(dx) >= reach or abs(dy) >= reach:
                continue
            distance = hypot(dx, dy)
            if distance < words.closest or distance >= reach:
                continue
            bearing = atan2(dy, dx)
            one = kinds[i] * sectors + _sector(directions[i] - bearing, sectors)
            other = kinds[j] * sectors + _sector(directions[j] - bearing - pi, sectors)
            weight = sqrt(min(hits[i], words.max_hits) * min(hits[j], words.max_hits))
            word = (min(one, other) * base + max(one, other)) * n_cells
            lower = floor(distance / cell)
            share = distance / cell - lower
            histogram[(word + lower) * _MULTIPLIER % bins] += weight * (1.0 - share)
            histogram[(word + lower + 1) * _MULTIPLIER % bins] += weight * share


@compiled
def count_distances(
    points: F64, starts: I64, poses: F64, reach: float, thinning: float, cell: float, histogram: F64
) -> None:
    """Add the distance of every pair of points near the middle of a place, thinned, to a histogram.

    Args:
        points: (n, 2) in the frames of their scans [m].
        starts: (m + 1,) scan k has the points from starts[k] to starts[k + 1].
        poses: (m, 3) pose of each scan as seen from the middle.
        reach: points farther from the middle are left out [m].
        thinning: of the others the first in each cell of this width counts [m].
        cell: width of the cells of the histogram [m].
        histogram: changed in place.
    """
    half = int(reach / thinning) + 1
    taken = np.zeros((2 * half + 1, 2 * half + 1), np.bool_)
    xs, ys = np.empty(taken.size), np.empty(taken.size)
    count = ZERO
    for scan in range(len(poses)):
        px, py, c, s = poses[scan, 0], poses[scan, 1], cos(poses[scan, 2]), sin(poses[scan, 2])
        for i in range(starts[scan], starts[scan + 1]):
            x = px + c * points[i, 0] - s * points[i, 1]
            y = py + s * points[i, 0] + c * points[i, 1]
            if hypot(x, y) >= reach:
                continue
            u, v = floor(x / thinning) + half, floor(y / thinning) + half
            if not taken[v, u]:
                taken[v, u] = True
                xs[count], ys[count] = x, y
                count += 1
    for i in range(count):
        for j in range(i + 1, count):
            dx, dy = xs[i] - xs[j], ys[i] - ys[j]
            k = int(sqrt(dx * dx + dy * dy) / cell)
            if k < len(histogram):
                histogram[k] += 1.0
