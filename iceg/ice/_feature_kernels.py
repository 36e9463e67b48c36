"""Kernels that turn the points of a scan into segments, and segments into features."""

from math import atan2, cos, hypot, pi, sin

import numpy as np
from numba import njit

# Columns of a segment: centroid x, y; unit direction in scan order; variance of the offset at the centroid;
# variance of the angle; along-line coordinate of first and last point; first and last point index.
CX, CY, TX, TY, V_OFFSET, V_ANGLE, FIRST, LAST, I_FIRST, I_LAST = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
SEGMENT_COLUMNS = 10
FEATURE_COLUMNS = 10


@njit(cache=True)
def _fit_line(points, a, b, sigma, out):
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
    worst, ss, along = 0.0, 0.0, 0.0
    first, last = 0.0, 0.0
    for i in range(a, b + 1):
        dx, dy = points[i, 0] - mx, points[i, 1] - my
        t, d = tx * dx + ty * dy, -ty * dx + tx * dy
        worst = max(worst, abs(d))
        ss += d * d
        along += t * t
        first, last = min(first, t), max(last, t)
    variance = max(sigma * sigma, ss / max(1, n - 2))
    out[CX], out[CY], out[TX], out[TY] = mx, my, tx, ty
    out[V_OFFSET] = variance / n
    out[V_ANGLE] = variance / max(along, 1e-9)
    out[FIRST], out[LAST] = first, last
    out[I_FIRST], out[I_LAST] = a, b
    return worst


@njit(cache=True)
def extract_segments(points, beams, n, origin, resolution, gap, split, min_points, min_length, sigma, segments):
    """Split-and-merge with a maximum-likelihood line fit; fill `segments` in scan order and return their count."""
    breaks = np.empty(2 * n + 2, np.int64)
    stack = np.empty((2 * n + 2, 2), np.int64)
    count, start = 0, 0
    line = np.empty(SEGMENT_COLUMNS)
    capacity = len(segments)
    for i in range(n):
        end = i == n - 1
        if not end:
            r = min(
                hypot(points[i, 0] - origin[0], points[i, 1] - origin[1]),
                hypot(points[i + 1, 0] - origin[0], points[i + 1, 1] - origin[1]),
            )
            steps = beams[i + 1] - beams[i]
            limit = gap + 4.0 * r * resolution
            end = hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]) > limit or steps > 3
        if not end:
            continue
        # Split the cluster start..i where a point is farthest from the chord.
        nb, top = 0, 0
        stack[0, 0], stack[0, 1] = start, i
        top = 1
        while top > 0:
            top -= 1
            a, b = stack[top, 0], stack[top, 1]
            if b - a < 2:
                breaks[nb] = a
                breaks[nb + 1] = b
                nb += 2
                continue
            ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
            length = hypot(ux, uy)
            worst, where = 0.0, a
            for k in range(a + 1, b):
                dx, dy = points[k, 0] - points[a, 0], points[k, 1] - points[a, 1]
                d = abs(ux * dy - uy * dx) / length if length > 1e-6 else hypot(dx, dy)
                if d > worst:
                    worst, where = d, k
            if worst > split and worst > 2.5 * sigma:
                stack[top, 0], stack[top, 1] = where, b
                stack[top + 1, 0], stack[top + 1, 1] = a, where
                top += 2
            else:
                breaks[nb] = a
                breaks[nb + 1] = b
                nb += 2
        # Merge neighbours that one line explains as well.
        k = 0
        while k < nb:
            a, b = breaks[k], breaks[k + 1]
            j = k + 2
            while j < nb and _fit_line(points, a, breaks[j + 1], sigma, line) <= split:
                b = breaks[j + 1]
                j += 2
            if b - a + 1 >= min_points:
                _fit_line(points, a, b, sigma, line)
                if line[LAST] - line[FIRST] >= min_length and count < capacity:
                    segments[count] = line
                    count += 1
            k = j
        start = i + 1
    return count


@njit(cache=True)
def _crossing(a, b, out):
    """Where the lines of two segments meet, with the covariance of that point; return the distances along each."""
    # normals
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


@njit(cache=True)
def extract_features(
    points, beams, n, origin, resolution, segments, corner_gap, extension, min_angle, weak_sigma, kinds, rows
):
    """Corners, ends of walls and intersections of the segments; return their count.

    rows: (capacity, 10) x, y, heading of the clockwise wall, heading of the counter-clockwise wall, var x, cov xy,
    var y, variance of the headings, 1 if real, distance from the laser.
    """
    count = 0
    capacity = len(kinds)
    n_segments = len(segments)
    cross = np.empty(5)
    # whether the first and last end of each segment already belong to a corner
    used = np.zeros((n_segments, 2), np.bool_)
    for i in range(n_segments):
        a = segments[i]
        for j in range(i + 1, n_segments):
            b = segments[j]
            if count >= capacity:
                return count
            # Turn from a to b in scan order.
            turn = atan2(a[TX] * b[TY] - a[TY] * b[TX], a[TX] * b[TX] + a[TY] * b[TY])
            if abs(turn) < min_angle or abs(turn) > pi - min_angle:
                continue
            ta, tb = _crossing(a, b, cross)
            from_a = ta - a[LAST]
            from_b = b[FIRST] - tb
            ea, eb = int(a[I_LAST]), int(b[I_FIRST])
            facing = hypot(points[ea, 0] - points[eb, 0], points[ea, 1] - points[eb, 1])
            corner = j == i + 1 and facing < corner_gap and abs(from_a) < corner_gap and abs(from_b) < corner_gap
            if not corner and (from_a < -0.2 or from_b < -0.2 or from_a > extension or from_b > extension):
                continue
            if corner:
                used[i, 1] = True
                used[j, 0] = True
            kinds[count] = 0 if corner else 2
            row = rows[count]
            row[0], row[1] = cross[0], cross[1]
            row[2] = atan2(-a[TY], -a[TX])
            row[3] = atan2(b[TY], b[TX])
            row[4], row[5], row[6] = cross[2] + 1e-5, cross[3], cross[4] + 1e-5
            row[7] = a[V_ANGLE] + b[V_ANGLE]
            row[8] = 1.0
            row[9] = hypot(cross[0] - origin[0], cross[1] - origin[1])
            count += 1
    for i in range(n_segments):
        a = segments[i]
        for end in range(2):
            if used[i, end] or count >= capacity:
                continue
            e = int(a[I_LAST]) if end == 1 else int(a[I_FIRST])
            neighbour = e + 1 if end == 1 else e - 1
            step = 1 if end == 1 else -1
            t = a[LAST] if end == 1 else a[FIRST]
            x, y = a[CX] + t * a[TX], a[CY] + t * a[TY]
            r = hypot(points[e, 0] - origin[0], points[e, 1] - origin[1])
            real = False
            if 0 <= neighbour < n and beams[neighbour] - beams[e] == step:
                rn = hypot(points[neighbour, 0] - origin[0], points[neighbour, 1] - origin[1])
                real = rn > r + 0.3
            vx, vy = (x - origin[0]) / max(r, 1e-6), (y - origin[1]) / max(r, 1e-6)
            incidence = max(0.05, abs(vx * a[TY] - vy * a[TX]))
            along = r * resolution / incidence * 0.5
            v_along = along * along + 1e-4
            if not real:
                v_along += weak_sigma * weak_sigma
            v_across = a[V_OFFSET] + t * t * a[V_ANGLE] + 1e-5
            kinds[count] = 1
            row = rows[count]
            row[0], row[1] = x, y
            if end == 1:
                row[2], row[3] = atan2(-a[TY], -a[TX]), np.nan
            else:
                row[2], row[3] = np.nan, atan2(a[TY], a[TX])
            row[4] = v_along * a[TX] * a[TX] + v_across * a[TY] * a[TY]
            row[5] = (v_along - v_across) * a[TX] * a[TY]
            row[6] = v_along * a[TY] * a[TY] + v_across * a[TX] * a[TX]
            row[7] = a[V_ANGLE]
            row[8] = 1.0 if real else 0.0
            row[9] = r
            count += 1
    return count


@njit(cache=True)
def smooth_on_segments(points, origin, segments, min_points, min_length, smoothed, normals):
    """Give the points of long segments the normal of their line, and put them onto it."""
    for k in range(len(segments)):
        line = segments[k]
        first, last = int(line[I_FIRST]), int(line[I_LAST])
        if last - first + 1 < min_points or line[LAST] - line[FIRST] < min_length:
            continue
        nx, ny = -line[TY], line[TX]
        if nx * (line[CX] - origin[0]) + ny * (line[CY] - origin[1]) > 0.0:
            nx, ny = -nx, -ny
        for i in range(first, last + 1):
            off = nx * (points[i, 0] - line[CX]) + ny * (points[i, 1] - line[CY])
            smoothed[i, 0] -= off * nx
            smoothed[i, 1] -= off * ny
            normals[i, 0], normals[i, 1] = nx, ny
