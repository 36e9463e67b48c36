"""Compiled loops from ranges to end points, surface normals and the noise of a scan."""

from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

# A surface ends where neighbouring points are farther apart than the jump plus this many beam spacings, at most so far.
_SPACINGS = 3.0
_WIDEST_GAP = 0.6
_MOST_NEIGHBOURS = 12
_THICKEST = 0.1
_STRETCH = 4


@compiled
def scan_points(
    ranges: F32, directions: F64, origin: F64, reach: float, jump: float, points: F64, normals: F64, beams: I32
) -> int:
    """End points, unit normals towards the laser and beam indices of the beams with a return.

    Args:
        ranges: (n_beams,) [m], NaN without return.
        directions: (n_beams, 2) unit vectors in the robot frame.
        origin: (2,) position of the laser in the robot frame [m].
        reach: neighbours up to this far on either side define the normal of a point [m].
        jump: see `_surfaces` [m].
        points: (n_beams, 2) output [m].
        normals: (n_beams, 2) output; 0, 0 where no line fits the neighbourhood.
        beams: (n_beams,) output.

    Returns:
        The number of returns.
    """
    n = _returns(ranges, directions, origin, points, beams)
    sums = np.empty((n + 1, 5))
    begin, end = np.empty(n, np.int64), np.empty(n, np.int64)
    _surfaces(points, beams, n, origin, _resolution(directions), jump, sums, begin, end)
    for i in range(n):
        first, last = _neighbourhood(points, begin[i], end[i], i, reach * reach)
        normals[i, 0], normals[i, 1] = _normal(sums, first, last, points[i, 0] - origin[0], points[i, 1] - origin[1])
    return n


@compiled
def thinned_points(
    ranges: F32,
    directions: F64,
    origin: F64,
    reach: float,
    jump: float,
    offsets: I64,
    every: int,
    points: F64,
    normals: F64,
    starts: I64,
) -> None:
    """As `scan_points`, for many scans of one laser, of each of which only every so many returns are kept.

    Args:
        ranges: (m, n_beams) [m], NaN without return.
        directions: see `scan_points`, as the following.
        origin: …
        reach: …
        jump: …
        offsets: (m,) the first return of each scan that is kept, below `every`.
        every: one in so many is kept.
        points: (capacity, 2) output [m].
        normals: (capacity, 2) output.
        starts: (m + 1,) output: scan k has those from starts[k] to starts[k + 1].
    """
    n_beams = ranges.shape[1]
    resolution = _resolution(directions)
    returns, beams = np.empty((n_beams, 2)), np.empty(n_beams, np.int32)
    sums = np.empty((n_beams + 1, 5))
    begin, end = np.empty(n_beams, np.int64), np.empty(n_beams, np.int64)
    count = 0
    starts[0] = 0
    for scan in range(len(ranges)):
        n = _returns(ranges[scan], directions, origin, returns, beams)
        _surfaces(returns, beams, n, origin, resolution, jump, sums, begin, end)
        for i in range(n):
            if i % every != offsets[scan]:
                continue
            first, last = _neighbourhood(returns, begin[i], end[i], i, reach * reach)
            nx, ny = _normal(sums, first, last, returns[i, 0] - origin[0], returns[i, 1] - origin[1])
            points[count, 0], points[count, 1] = returns[i, 0], returns[i, 1]
            normals[count, 0], normals[count, 1] = nx, ny
            count += 1
        starts[scan + 1] = count


@compiled
def _resolution(directions: F64) -> float:
    """Distance of two neighbouring beams, 1 m out [m]."""
    if len(directions) < 2:
        return 0.0
    return hypot(directions[1, 0] - directions[0, 0], directions[1, 1] - directions[0, 1])


@compiled
def _returns(ranges: F32, directions: F64, origin: F64, points: F64, beams: I32) -> int:
    """End points and beam indices of the beams with a return; their number."""
    n = 0
    for b in range(len(ranges)):
        r = ranges[b]
        if not np.isnan(r):
            points[n, 0] = origin[0] + r * directions[b, 0]
            points[n, 1] = origin[1] + r * directions[b, 1]
            beams[n] = b
            n += 1
    return n


@compiled
def _surfaces(
    points: F64, beams: I32, n: int, origin: F64, resolution: float, jump: float, sums: F64, begin: I64, end: I64
) -> None:
    """First and last point of the surface (run of points without a jump) that each point lies on.

    Also sums up x, y, xx, xy, yy relative to the laser: running sums make the moments of any stretch two look-ups.
    """
    sums[0] = 0.0
    start = 0
    for i in range(n):
        x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
        sums[i + 1, 0] = sums[i, 0] + x
        sums[i + 1, 1] = sums[i, 1] + y
        sums[i + 1, 2] = sums[i, 2] + x * x
        sums[i + 1, 3] = sums[i, 3] + x * y
        sums[i + 1, 4] = sums[i, 4] + y * y
        if i > 0:
            gap = min(_WIDEST_GAP, jump + _SPACINGS * resolution * sqrt(x * x + y * y)) * (beams[i] - beams[i - 1])
            dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
            if dx * dx + dy * dy > gap * gap:
                end[start:i] = i - 1
                start = i
        begin[i] = start
    end[start:n] = n - 1


@compiled
def _neighbourhood(points: F64, begin: int, end: int, i: int, reach2: float) -> tuple[int, int]:
    """First and last point around i on its surface, begin..end: up to the reach, but at least two on either side."""
    x, y = points[i, 0], points[i, 1]
    first, last = i, i
    stop = max(begin, i - _MOST_NEIGHBOURS)
    while first > stop:
        first -= 1
        dx, dy = points[first, 0] - x, points[first, 1] - y
        if dx * dx + dy * dy >= reach2 and i - first >= 2:
            break
    stop = min(end, i + _MOST_NEIGHBOURS)
    while last < stop:
        last += 1
        dx, dy = points[last, 0] - x, points[last, 1] - y
        if dx * dx + dy * dy >= reach2 and last - i >= 2:
            break
    return first, last


@compiled
def _normal(sums: F64, first: int, last: int, rx: float, ry: float) -> tuple[float, float]:
    """Normal of the line through points first..last, against the ray (rx, ry); 0, 0 where they are no line."""
    m = last - first + 1
    if m < 3:
        return 0.0, 0.0
    mx = (sums[last + 1, 0] - sums[first, 0]) / m
    my = (sums[last + 1, 1] - sums[first, 1]) / m
    cxx = (sums[last + 1, 2] - sums[first, 2]) / m - mx * mx
    cxy = (sums[last + 1, 3] - sums[first, 3]) / m - mx * my
    cyy = (sums[last + 1, 4] - sums[first, 4]) / m - my * my
    half = 0.5 * (cxx + cyy)
    root = sqrt(0.25 * (cxx - cyy) ** 2 + cxy * cxy)
    small, large = half - root, half + root
    if large <= 0.0 or small > _THICKEST * large:
        return 0.0, 0.0
    # Eigenvector of the smaller eigenvalue, from the better conditioned row.
    ax, ay = cxy, small - cxx
    bx, by = small - cyy, cxy
    if ax * ax + ay * ay < bx * bx + by * by:
        ax, ay = bx, by
    norm = sqrt(ax * ax + ay * ay)
    if norm < 1e-12:
        ax, ay, norm = (1.0, 0.0, 1.0) if cxx < cyy else (0.0, 1.0, 1.0)
    if ax * rx + ay * ry > 0.0:
        norm = -norm
    return ax / norm, ay / norm


@compiled
def count_returns(ranges: F32, near: float) -> tuple[int, int]:
    """How many beams returned, and how many of these from nearer than `near` [m]."""
    returns, close = 0, 0
    for b in range(len(ranges)):
        returns += ranges[b] >= 0.0
        close += ranges[b] < near
    return returns, close


@compiled
def range_noise(points: F64, beams: I32) -> float:
    """Standard deviation of the points across the surfaces they lie on [m].

    The second difference of three neighbouring points, across the chord of a longer stretch, is zero on any straight
    wall, whatever its incidence, and has six times a point's variance; the median ignores corners and jumps.
    """
    n = len(points)
    off = np.empty(n)
    count = 0
    for i in range(_STRETCH, n - _STRETCH):
        a, b = i - _STRETCH, i + _STRETCH
        if beams[b] - beams[a] != 2 * _STRETCH:
            continue
        ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        dx = points[i - 1, 0] - 2.0 * points[i, 0] + points[i + 1, 0]
        dy = points[i - 1, 1] - 2.0 * points[i, 1] + points[i + 1, 1]
        off[count] = abs(ux * dy - uy * dx) / max(hypot(ux, uy), 1e-9)
        count += 1
    if count == 0:
        return 0.0
    return float(np.median(off[:count])) / (0.6745 * sqrt(6.0))
