"""Compiled loops that cut the points of a scan into segments, and make features of the segments."""

from math import atan2, cos, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph.compiled import ZERO, compiled
from iceg.ice._noise_kernels import range_noise

F64 = NDArray[np.float64]
I8 = NDArray[np.int8]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

# Columns of a segment: centroid x, y; unit direction in scan order; variance of the offset at the centroid;
# variance of the angle; along-line coordinate of first and last point; first and last point index.
CX, CY, TX, TY, V_OFFSET, V_ANGLE, FIRST, LAST, I_FIRST, I_LAST = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
SEGMENT_COLUMNS = 10
# Columns of a feature: x, y, heading of the clockwise wall, of the counter-clockwise wall, var x, cov xy, var y,
# variance of the headings, 1 if real, distance from the laser.
FEATURE_COLUMNS = 10

_CORNER, _END_OF_WALL, _INTERSECTION = 0, 1, 2
_SPACINGS = 4.0
"""A cluster ends where points are farther apart than the gap and so many beam spacings …"""
_MISSING_BEAMS = 3
"""… or where the next return lies more than so many beams on."""
_OVERLAP = 0.2
"""Two segments that run past their intersection by more than this do not meet there [m]."""
_BEHIND = 0.3
"""The end of a wall is real where the next point lies this much farther away [m]."""
_FLOOR = 1e-5
"""Added to the variance of a feature's position [m²]."""
_LEAST_SCATTER2 = 0.003**2
"""Points scatter by no less about their wall: ranges in steps of 1 cm [m²]."""
_BENT = 10.0
"""A wall bends as far as the square of its bend exceeds so many times what scatter alone would make of it."""


@compiled
def _fit_line(points: F64, a: int, b: int, sigma: float, out: F64) -> float:
    """Total least squares through points[a..b]; return the largest distance of a point from the line."""
    n = b - a + 1
    mx, my = 0.0, 0.0
    for i in range(a, b + 1):
        mx += points[i, 0]
        my += points[i, 1]
    mx /= n
    my /= n
    sxx, sxy, syy = 0.0, 0.0, 0.0
    for i in range(a, b + 1):
        dx, dy = points[i, 0] - mx, points[i, 1] - my
        sxx += dx * dx
        sxy += dx * dy
        syy += dy * dy
    angle = 0.5 * atan2(2.0 * sxy, sxx - syy)
    tx, ty = cos(angle), sin(angle)
    if tx * (points[b, 0] - points[a, 0]) + ty * (points[b, 1] - points[a, 1]) < 0.0:
        tx, ty = -tx, -ty
    worst, squares, along = 0.0, 0.0, 0.0
    first, last = 0.0, 0.0
    for i in range(a, b + 1):
        dx, dy = points[i, 0] - mx, points[i, 1] - my
        t, d = tx * dx + ty * dy, -ty * dx + tx * dy
        worst = max(worst, abs(d))
        squares += d * d
        along += t * t
        first, last = min(first, t), max(last, t)
    variance = max(sigma * sigma, squares / max(1, n - 2))
    out[CX], out[CY], out[TX], out[TY] = mx, my, tx, ty
    out[V_OFFSET] = variance / n
    out[V_ANGLE] = variance / max(along, 1e-9)
    out[FIRST], out[LAST] = first, last
    out[I_FIRST], out[I_LAST] = a, b
    return worst


@compiled
def _cluster_ends(points: F64, beams: I32, i: int, origin: F64, resolution: float, gap: float) -> bool:
    """Whether a new surface starts after point i."""
    nearer = min(
        hypot(points[i, 0] - origin[0], points[i, 1] - origin[1]),
        hypot(points[i + 1, 0] - origin[0], points[i + 1, 1] - origin[1]),
    )
    apart = hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
    return apart > gap + _SPACINGS * nearer * resolution or beams[i + 1] - beams[i] > _MISSING_BEAMS


@compiled
def _farthest_from_chord(points: F64, a: int, b: int) -> tuple[float, int]:
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    length = hypot(ux, uy)
    worst, where = 0.0, a
    for k in range(a + 1, b):
        dx, dy = points[k, 0] - points[a, 0], points[k, 1] - points[a, 1]
        d = abs(ux * dy - uy * dx) / length if length > 1e-6 else hypot(dx, dy)
        if d > worst:
            worst, where = d, k
    return worst, where


@compiled
def _split(points: F64, start: int, end: int, tolerance: float, stack: I64, pieces: I64) -> int:
    """Split start..end where a point lies farthest from the chord; return the number of pieces, in scan order."""
    count, top = 0, 1
    stack[0, 0], stack[0, 1] = start, end
    while top > 0:
        top -= 1
        a, b = stack[top, 0], stack[top, 1]
        worst, where = _farthest_from_chord(points, a, b)
        if worst > tolerance:
            stack[top, 0], stack[top, 1] = where, b
            stack[top + 1, 0], stack[top + 1, 1] = a, where
            top += 2
        else:
            pieces[count, 0], pieces[count, 1] = a, b
            count += 1
    return count


@compiled
def extract_segments(
    points: F64,
    beams: I32,
    origin: F64,
    resolution: float,
    gap: float,
    split: float,
    split_sigmas: float,
    min_points: int,
    min_length: float,
    least_noise: float,
    segments: F64,
) -> int:
    """Split-and-merge with a maximum-likelihood line fit.

    The tolerance of the split follows the scan's own noise: on a noisy laser a fixed one would cut walls to pieces.

    Args:
        points: (n, 2) in beam order [m].
        beams: (n,) index of each point's beam.
        origin: (2,) position of the laser [m].
        resolution: angle between two beams [rad].
        gap: neighbouring points farther apart than this plus four beam spacings are on two surfaces [m].
        split: largest distance of a point from its line [m] …
        split_sigmas: … or so many standard deviations of the points across their surfaces if that is more.
        min_points: fewest points of a segment.
        min_length: shortest segment [m].
        least_noise: least standard deviation of a point across its line [m].
        segments: (capacity, SEGMENT_COLUMNS) output, in scan order.

    Returns:
        The number of segments.
    """
    noise = range_noise(points, beams)
    tolerance, sigma = max(split, split_sigmas * noise), max(least_noise, noise)
    n, capacity = len(points), len(segments)
    stack, pieces = np.empty((n + 2, 2), np.int64), np.empty((n + 2, 2), np.int64)
    line = np.empty(SEGMENT_COLUMNS)
    count, start = 0, ZERO
    for i in range(n):
        if i < n - 1 and not _cluster_ends(points, beams, i, origin, resolution, gap):
            continue
        n_pieces = _split(points, start, i, tolerance, stack, pieces)
        start = i + 1
        k = 0
        while k < n_pieces:
            a, b = pieces[k, 0], pieces[k, 1]
            k += 1
            # Merge neighbours that one line explains as well.
            while k < n_pieces and _fit_line(points, a, pieces[k, 1], sigma, line) <= tolerance:
                b = pieces[k, 1]
                k += 1
            if b - a + 1 < min_points or count == capacity:
                continue
            _fit_line(points, a, b, sigma, line)
            if line[LAST] - line[FIRST] >= min_length:
                assign(segments[count], line)
                count += 1
    return count


@compiled
def smooth_on_segments(
    points: F64, origin: F64, segments: F64, min_points: int, min_length: float, smoothed: F64, normals: F64
) -> None:
    """Put the points of long segments onto their curve, and give them its normals, towards the laser.

    The curve is the line, bent as far as the points say beyond what they scatter: put onto straight pieces, the wall of
    a round corridor would be a polygon that goes along with the robot.
    """
    for k in range(len(segments)):
        line = segments[k]
        first, last = int(line[I_FIRST]), int(line[I_LAST])
        if last - first + 1 < min_points or line[LAST] - line[FIRST] < min_length:
            continue
        nx, ny = -line[TY], line[TX]
        if nx * (line[CX] - origin[0]) + ny * (line[CY] - origin[1]) > 0.0:
            nx, ny = -nx, -ny
        bend, middle, skew, spread = _bend(points, line, nx, ny)
        for i in range(first, last + 1):
            dx, dy = points[i, 0] - line[CX], points[i, 1] - line[CY]
            t = ny * dx - nx * dy - middle
            off = nx * dx + ny * dy - bend * (t * t - skew * t - spread)
            smoothed[i, 0] = points[i, 0] - off * nx
            smoothed[i, 1] = points[i, 1] - off * ny
            slope = bend * (2.0 * t - skew)
            mx, my = nx - slope * ny, ny + slope * nx
            size = hypot(mx, my)
            normals[i, 0], normals[i, 1] = mx / size, my / size


@compiled
def _bend(points: F64, line: F64, nx: float, ny: float) -> tuple[float, float, float, float]:
    """The parabola across a segment, less what scatter alone would make of it.

    Args:
        points: (n, 2) of the scan.
        line: a segment.
        nx: its normal …
        ny: … as this.

    Returns:
        b, m, k, s: at t along (ny, -nx) from the centroid it lies b (u² - k u - s) off the line, with u = t - m. That
        is orthogonal to all lines, so that the line remains the best one.
    """
    first, last = int(line[I_FIRST]), int(line[I_LAST])
    n, t1, t2, t3, squares, before = float(last - first + 1), 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(first, last + 1):
        dx, dy = points[i, 0] - line[CX], points[i, 1] - line[CY]
        t, off = ny * dx - nx * dy, nx * dx + ny * dy
        t1, t2, t3 = t1 + t, t2 + t * t, t3 + t * t * t
        squares += (off - before) * (off - before) if i > first else 0.0
        before = off
    middle = t1 / n
    spread = t2 / n - middle * middle
    skew = (t3 / n - 3.0 * middle * t2 / n + 2.0 * middle * middle * middle) / spread
    along, bows = 0.0, 0.0
    for i in range(first, last + 1):
        dx, dy = points[i, 0] - line[CX], points[i, 1] - line[CY]
        u, off = ny * dx - nx * dy - middle, nx * dx + ny * dy
        bow = u * u - skew * u - spread
        along, bows = along + off * bow, bows + bow * bow
    if bows < 1e-12 or along == 0.0:
        return 0.0, middle, skew, spread
    # Neighbours on a curve differ by their scatter alone (von Neumann 1941).
    scatter2 = max(0.5 * squares / (n - 1.0), _LEAST_SCATTER2)
    return along / bows * max(0.0, 1.0 - _BENT * scatter2 * bows / (along * along)), middle, skew, spread


@compiled
def _crossing(a: F64, b: F64, out: F64) -> tuple[float, float]:
    """Where the lines of two segments meet: out = x, y, var x, cov xy, var y; return where along each line."""
    ax, ay = -a[TY], a[TX]
    bx, by = -b[TY], b[TX]
    det = ax * by - ay * bx
    ca = ax * a[CX] + ay * a[CY]
    cb = bx * b[CX] + by * b[CY]
    x = (by * ca - ay * cb) / det
    y = (ax * cb - bx * ca) / det
    ta = a[TX] * (x - a[CX]) + a[TY] * (y - a[CY])
    tb = b[TX] * (x - b[CX]) + b[TY] * (y - b[CY])
    va = a[V_OFFSET] + ta * ta * a[V_ANGLE]
    vb = b[V_OFFSET] + tb * tb * b[V_ANGLE]
    m00, m01, m10, m11 = by / det, -ay / det, -bx / det, ax / det
    out[0], out[1] = x, y
    out[2] = m00 * m00 * va + m01 * m01 * vb
    out[3] = m00 * m10 * va + m01 * m11 * vb
    out[4] = m10 * m10 * va + m11 * m11 * vb
    return ta, tb


@compiled
def _corners_and_intersections(
    points: F64,
    origin: F64,
    segments: F64,
    corner_gap: float,
    extension: float,
    min_angle: float,
    kinds: I8,
    rows: F64,
    in_corner: Bool,
) -> int:
    """Where the lines of two segments meet; mark the ends (first, last) of segments that belong to a corner."""
    count = 0
    cross = np.empty(5)
    for i in range(len(segments)):
        a = segments[i]
        for j in range(i + 1, len(segments)):
            b = segments[j]
            turn = abs(atan2(a[TX] * b[TY] - a[TY] * b[TX], a[TX] * b[TX] + a[TY] * b[TY]))
            if turn < min_angle or turn > pi - min_angle:
                continue
            ta, tb = _crossing(a, b, cross)
            from_a, from_b = ta - a[LAST], b[FIRST] - tb
            ea, eb = int(a[I_LAST]), int(b[I_FIRST])
            facing = hypot(points[ea, 0] - points[eb, 0], points[ea, 1] - points[eb, 1])
            corner = j == i + 1 and facing < corner_gap and abs(from_a) < corner_gap and abs(from_b) < corner_gap
            if not corner and (min(from_a, from_b) < -_OVERLAP or max(from_a, from_b) > extension):
                continue
            if count == len(kinds):
                return count
            if corner:
                in_corner[i, 1] = True
                in_corner[j, 0] = True
            kinds[count] = _CORNER if corner else _INTERSECTION
            row = rows[count]
            row[0], row[1] = cross[0], cross[1]
            row[2], row[3] = atan2(-a[TY], -a[TX]), atan2(b[TY], b[TX])
            row[4], row[5], row[6] = cross[2] + _FLOOR, cross[3], cross[4] + _FLOOR
            row[7] = a[V_ANGLE] + b[V_ANGLE]
            row[8] = 1.0
            row[9] = hypot(cross[0] - origin[0], cross[1] - origin[1])
            count += 1
    return count


@compiled
def _visibly_ends(points: F64, beams: I32, origin: F64, end: int, step: int, distance: float) -> bool:
    """Whether the next beam passes the end of a wall and meets something behind it.

    Without that beam (the edge of the field of view, no return) or with something nearer nobody knows where it ends.
    """
    following = end + step
    if following < 0 or following >= len(points) or beams[following] - beams[end] != step:
        return False
    return hypot(points[following, 0] - origin[0], points[following, 1] - origin[1]) > distance + _BEHIND


@compiled
def _end_of_wall(
    points: F64, beams: I32, origin: F64, resolution: float, line: F64, at_last: bool, weak_sigma: float, row: F64
) -> None:
    """One end of a segment as a feature; along the wall it is known to half a beam's footprint if it is real."""
    end = int(line[I_LAST]) if at_last else int(line[I_FIRST])
    t = line[LAST] if at_last else line[FIRST]
    tx, ty = line[TX], line[TY]
    x, y = line[CX] + t * tx, line[CY] + t * ty
    distance = hypot(points[end, 0] - origin[0], points[end, 1] - origin[1])
    real = _visibly_ends(points, beams, origin, end, 1 if at_last else -1, distance)
    incidence = max(0.05, abs((x - origin[0]) * ty - (y - origin[1]) * tx) / max(distance, 1e-6))
    footprint = 0.5 * distance * resolution / incidence
    v_along = footprint * footprint + 1e-4
    if not real:
        v_along += weak_sigma * weak_sigma
    v_across = line[V_OFFSET] + t * t * line[V_ANGLE] + _FLOOR
    row[0], row[1] = x, y
    row[2] = atan2(-ty, -tx) if at_last else np.nan
    row[3] = np.nan if at_last else atan2(ty, tx)
    row[4] = v_along * tx * tx + v_across * ty * ty
    row[5] = (v_along - v_across) * tx * ty
    row[6] = v_along * ty * ty + v_across * tx * tx
    row[7] = line[V_ANGLE]
    row[8] = 1.0 if real else 0.0
    row[9] = distance


@compiled
def extract_features(
    points: F64,
    beams: I32,
    origin: F64,
    resolution: float,
    segments: F64,
    corner_gap: float,
    extension: float,
    min_angle: float,
    weak_sigma: float,
    kinds: I8,
    rows: F64,
) -> int:
    """Corners, ends of walls and intersections of the segments.

    Args:
        points: (n, 2) in beam order [m].
        beams: (n,) index of each point's beam.
        origin: (2,) position of the laser [m].
        resolution: angle between two beams [rad].
        segments: (m, SEGMENT_COLUMNS) in scan order.
        corner_gap: facing ends closer than this make a corner [m].
        extension: farthest a wall is extended to an intersection [m].
        min_angle: smallest angle between two walls that meet [rad].
        weak_sigma: standard deviation along the wall of an end that is not visible [m].
        kinds: (capacity,) output.
        rows: (capacity, FEATURE_COLUMNS) output.

    Returns:
        The number of features; corners and intersections come first.
    """
    in_corner = np.zeros((len(segments), 2), np.bool_)
    count = _corners_and_intersections(
        points, origin, segments, corner_gap, extension, min_angle, kinds, rows, in_corner
    )
    for i in range(len(segments)):
        for end in range(2):
            if in_corner[i, end] or count == len(kinds):
                continue
            kinds[count] = _END_OF_WALL
            _end_of_wall(points, beams, origin, resolution, segments[i], end == 1, weak_sigma, rows[count])
            count += 1
    return count
