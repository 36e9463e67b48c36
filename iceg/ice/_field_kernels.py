"""Kernels on points: normals of a scan, the surfel field of a local map, refinement and scores on it.

A *surfel* is the mean of the reference points that fall into one small cell and face the same way, with their mean
normal. The *field* stores for every cell of a regular grid which surfel is nearest, so that a correspondence costs
one look-up.
"""

from math import atan2, cos, floor, hypot, log, pi, sin, sqrt

import numpy as np
from numba import njit


@njit(cache=True)
def scan_points(ranges, directions, origin, reach, jump, points, normals, beams):
    """Fill end points, unit normals towards the laser (0, 0 where no line fits) and beam indices; return their count."""
    n = 0
    for b in range(len(ranges)):
        r = ranges[b]
        if r == r:
            points[n, 0] = origin[0] + r * directions[b, 0]
            points[n, 1] = origin[1] + r * directions[b, 1]
            beams[n] = b
            n += 1
    resolution = 0.0
    if len(ranges) > 1:
        resolution = hypot(directions[1, 0] - directions[0, 0], directions[1, 1] - directions[0, 1])
    # Running sums make the moments of any stretch of points two look-ups; runs end where the surface jumps.
    sums = np.zeros((n + 1, 5))
    run = np.empty(n, np.int64)
    for i in range(n):
        x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
        sums[i + 1, 0] = sums[i, 0] + x
        sums[i + 1, 1] = sums[i, 1] + y
        sums[i + 1, 2] = sums[i, 2] + x * x
        sums[i + 1, 3] = sums[i, 3] + x * y
        sums[i + 1, 4] = sums[i, 4] + y * y
        if i == 0:
            run[i] = 0
            continue
        gap = min(0.6, jump + 3.0 * resolution * sqrt(x * x + y * y)) * (beams[i] - beams[i - 1])
        dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        run[i] = run[i - 1] if dx * dx + dy * dy <= gap * gap else run[i - 1] + 1
    reach2 = reach * reach
    for i in range(n):
        first, last = i, i
        while first > 0 and run[first - 1] == run[i] and i - first < 12:
            first -= 1
            dx, dy = points[first, 0] - points[i, 0], points[first, 1] - points[i, 1]
            if i - first >= 2 and dx * dx + dy * dy >= reach2:
                break
        while last + 1 < n and run[last + 1] == run[i] and last - i < 12:
            last += 1
            dx, dy = points[last, 0] - points[i, 0], points[last, 1] - points[i, 1]
            if last - i >= 2 and dx * dx + dy * dy >= reach2:
                break
        m = last - first + 1
        rx, ry = points[i, 0] - origin[0], points[i, 1] - origin[1]
        normals[i, 0] = 0.0
        normals[i, 1] = 0.0
        if m < 3:
            continue
        mx = (sums[last + 1, 0] - sums[first, 0]) / m
        my = (sums[last + 1, 1] - sums[first, 1]) / m
        cxx = (sums[last + 1, 2] - sums[first, 2]) / m - mx * mx
        cxy = (sums[last + 1, 3] - sums[first, 3]) / m - mx * my
        cyy = (sums[last + 1, 4] - sums[first, 4]) / m - my * my
        half = 0.5 * (cxx + cyy)
        root = sqrt(0.25 * (cxx - cyy) ** 2 + cxy * cxy)
        small, large = half - root, half + root
        if large <= 0.0 or small > 0.1 * large:
            continue
        # Eigenvector of the smaller eigenvalue, from the better conditioned row.
        ax, ay = cxy, small - cxx
        bx, by = small - cyy, cxy
        if ax * ax + ay * ay < bx * bx + by * by:
            ax, ay = bx, by
        norm = hypot(ax, ay)
        if norm < 1e-12:
            if cxx < cyy:
                ax, ay, norm = 1.0, 0.0, 1.0
            else:
                ax, ay, norm = 0.0, 1.0, 1.0
        ax /= norm
        ay /= norm
        if ax * rx + ay * ry > 0.0:
            ax, ay = -ax, -ay
        normals[i, 0] = ax
        normals[i, 1] = ay
    return n


@njit(cache=True)
def add_surfels(points, normals, pose, origin, cell, table, sums, n_surfels):
    """Add one scan's points, moved by `pose`, to the surfel sums; return the new number of surfels.

    table: (ny, nx, 2) int32 surfel of each cell and facing, -1 where none. sums: (capacity, 5) Σx, Σy, Σnx, Σny, count.
    """
    c, s = cos(pose[2]), sin(pose[2])
    ny, nx = table.shape[0], table.shape[1]
    for i in range(len(points)):
        if normals[i, 0] == 0.0 and normals[i, 1] == 0.0:
            continue
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        u = int(floor((x - origin[0]) / cell))
        v = int(floor((y - origin[1]) / cell))
        if u < 0 or v < 0 or u >= nx or v >= ny:
            continue
        nxr = c * normals[i, 0] - s * normals[i, 1]
        nyr = s * normals[i, 0] + c * normals[i, 1]
        for slot in range(2):
            k = table[v, u, slot]
            if k < 0:
                if n_surfels >= len(sums):
                    return n_surfels
                table[v, u, slot] = n_surfels
                sums[n_surfels, 0] = x
                sums[n_surfels, 1] = y
                sums[n_surfels, 2] = nxr
                sums[n_surfels, 3] = nyr
                sums[n_surfels, 4] = 1.0
                n_surfels += 1
                break
            if sums[k, 2] * nxr + sums[k, 3] * nyr > 0.6 * sums[k, 4]:
                sums[k, 0] += x
                sums[k, 1] += y
                sums[k, 2] += nxr
                sums[k, 3] += nyr
                sums[k, 4] += 1.0
                break
    return n_surfels


@njit(cache=True)
def mean_surfels(sums, start, end, surfels):
    """Turn sums into surfels: mean x, y and unit normal."""
    for k in range(start, end):
        n = sums[k, 4]
        norm = hypot(sums[k, 2], sums[k, 3])
        surfels[k, 0], surfels[k, 1] = sums[k, 0] / n, sums[k, 1] / n
        surfels[k, 2], surfels[k, 3] = sums[k, 2] / norm, sums[k, 3] / norm


@njit(cache=True)
def stamp_field(surfels, start, end, origin, cell, radius, nearest, distance2, thin):
    """Write into every cell within `radius` of surfels[start:end] the index of the nearest one.

    With `thin`, a surfel whose own cell already holds one closer than a cell's width is left out.
    """
    ny, nx = nearest.shape
    span = int(radius / cell) + 1
    reach2 = radius * radius
    for k in range(start, end):
        x = (surfels[k, 0] - origin[0]) / cell - 0.5
        y = (surfels[k, 1] - origin[1]) / cell - 0.5
        u, v = int(floor(x + 0.5)), int(floor(y + 0.5))
        if u < 0 or v < 0 or u >= nx or v >= ny:
            continue
        if thin and nearest[v, u] >= 0 and distance2[v, u] < 0.3 * cell * cell:
            continue
        for b in range(max(0, v - span), min(ny, v + span + 1)):
            dy = (b - y) * cell
            for a in range(max(0, u - span), min(nx, u + span + 1)):
                dx = (a - x) * cell
                d2 = dx * dx + dy * dy
                if d2 <= reach2 and (nearest[b, a] < 0 or d2 < distance2[b, a]):
                    distance2[b, a] = d2
                    nearest[b, a] = k


@njit(cache=True)
def refine(
    points,
    normals,
    start,
    surfels,
    nearest,
    origin,
    cell,
    scale0,
    scale,
    iterations,
    prior_weight,
    facing,
    pose,
    hessian,
):
    """Point-to-line Gauss-Newton with Cauchy weights, scale falling from `scale0` to `scale`; return inlier count and used count."""
    pose[0], pose[1], pose[2] = start[0], start[1], start[2]
    ny, nx = nearest.shape
    inliers, used = 0, 0
    squares, weight = 0.0, 1e-9
    last = iterations == 0
    for it in range(max(1, iterations)):
        c, s = cos(pose[2]), sin(pose[2])
        k2 = max(scale, scale0 * 0.6**it)
        k2 = k2 * k2
        h00, h01, h02, h11, h12, h22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        g0, g1, g2 = 0.0, 0.0, 0.0
        inliers, used = 0, 0
        squares, weight = 0.0, 1e-9
        for i in range(len(points)):
            px, py = points[i, 0], points[i, 1]
            rx, ry = c * px - s * py, s * px + c * py
            x, y = pose[0] + rx, pose[1] + ry
            u = int(floor((x - origin[0]) / cell))
            v = int(floor((y - origin[1]) / cell))
            if u < 0 or v < 0 or u >= nx or v >= ny:
                continue
            k = nearest[v, u]
            if k < 0:
                continue
            qx, qy, mx, my = surfels[k, 0], surfels[k, 1], surfels[k, 2], surfels[k, 3]
            nxr = c * normals[i, 0] - s * normals[i, 1]
            nyr = s * normals[i, 0] + c * normals[i, 1]
            dot = nxr * mx + nyr * my
            if dot < facing and (normals[i, 0] != 0.0 or normals[i, 1] != 0.0):
                continue
            used += 1
            r = mx * (x - qx) + my * (y - qy)
            w = 1.0 / (1.0 + r * r / k2)
            squares += w * r * r
            weight += w
            if r * r < 4.0 * scale * scale:
                inliers += 1
            # derivative with respect to a step of the pose in the reference frame, rotation about the robot
            j2 = -mx * ry + my * rx
            h00 += w * mx * mx
            h01 += w * mx * my
            h11 += w * my * my
            h02 += w * mx * j2
            h12 += w * my * j2
            h22 += w * j2 * j2
            g0 += w * mx * r
            g1 += w * my * r
            g2 += w * j2 * r
        hessian[0, 0], hessian[0, 1], hessian[0, 2] = h00, h01, h02
        hessian[1, 0], hessian[1, 1], hessian[1, 2] = h01, h11, h12
        hessian[2, 0], hessian[2, 1], hessian[2, 2] = h02, h12, h22
        if used < 5 or last:
            break
        g0 -= prior_weight * (start[0] - pose[0])
        g1 -= prior_weight * (start[1] - pose[1])
        g2 -= prior_weight * (start[2] - pose[2])
        h00 += prior_weight
        h11 += prior_weight
        h22 += prior_weight
        a00 = h11 * h22 - h12 * h12
        a01 = h02 * h12 - h01 * h22
        a02 = h01 * h12 - h02 * h11
        det = h00 * a00 + h01 * a01 + h02 * a02
        if abs(det) < 1e-12:
            break
        a11 = h00 * h22 - h02 * h02
        a12 = h01 * h02 - h00 * h12
        a22 = h00 * h11 - h01 * h01
        s0 = -(a00 * g0 + a01 * g1 + a02 * g2) / det
        s1 = -(a01 * g0 + a11 * g1 + a12 * g2) / det
        s2 = -(a02 * g0 + a12 * g1 + a22 * g2) / det
        pose[0] += s0
        pose[1] += s1
        pose[2] += s2
        if it >= 3 and abs(s0) < 2e-4 and abs(s1) < 2e-4 and abs(s2) < 1e-4 and scale0 * 0.6**it <= scale:
            last = True
    return inliers, used, sqrt(squares / weight)


@njit(cache=True)
def score_grid(points, normals, picks, surfels, nearest, origin, cell, scale, facing, pose, axes, steps, half, costs):
    """Costs on a grid of poses around `pose`; return the smallest.

    The grid has 2·half+1 values along each column of `axes` (tangent of the robot at `pose`), `steps` apart. The
    cost of a pose is Σ log(1 + r²/scale²) over the picked points, r the distance to the nearest surfel's line; a
    point that leaves the reference costs as much as one 3·scale away.
    """
    ny, nx = nearest.shape
    side = 2 * half + 1
    most = 10.0
    inverse_cell, inverse_scale2 = 1.0 / cell, 1.0 / (scale * scale)
    best = 1e300
    c0, s0 = cos(pose[2]), sin(pose[2])
    for i0 in range(side):
        for i1 in range(side):
            for i2 in range(side):
                g0, g1, g2 = (i0 - half) * steps[0], (i1 - half) * steps[1], (i2 - half) * steps[2]
                d0 = axes[0, 0] * g0 + axes[0, 1] * g1 + axes[0, 2] * g2
                d1 = axes[1, 0] * g0 + axes[1, 1] * g1 + axes[1, 2] * g2
                d2 = axes[2, 0] * g0 + axes[2, 1] * g1 + axes[2, 2] * g2
                x0, y0 = pose[0] + c0 * d0 - s0 * d1, pose[1] + s0 * d0 + c0 * d1
                c, s = cos(pose[2] + d2), sin(pose[2] + d2)
                cost, product = 0.0, 1.0
                for q in range(len(picks)):
                    i = picks[q]
                    x = x0 + c * points[i, 0] - s * points[i, 1]
                    y = y0 + s * points[i, 0] + c * points[i, 1]
                    u, v = int((x - origin[0]) * inverse_cell), int((y - origin[1]) * inverse_cell)
                    factor = most
                    if 0 <= u < nx and 0 <= v < ny:
                        k = nearest[v, u]
                        if k >= 0:
                            mx, my = surfels[k, 2], surfels[k, 3]
                            nx0, ny0 = normals[i, 0], normals[i, 1]
                            dot = (c * nx0 - s * ny0) * mx + (s * nx0 + c * ny0) * my
                            if dot >= facing or (nx0 == 0.0 and ny0 == 0.0):
                                r = mx * (x - surfels[k, 0]) + my * (y - surfels[k, 1])
                                factor = min(most, 1.0 + r * r * inverse_scale2)
                    product *= factor
                    if product > 1e200:
                        cost += log(product)
                        product = 1.0
                cost += log(product)
                costs[i0, i1, i2] = cost
                best = min(best, cost)
    return best


@njit(cache=True)
def visible_agreement(surfels, pose, origin, heading, bearing0, resolution, ranges, near, margin):
    """Count the surfels a scan taken at `pose` should see: those where it ends, and those it looks through.

    origin, heading: mount of the laser on the robot. A surfel counts as seen when a beam ends within `margin` of it,
    as contradicted when its own beam and both neighbours end more than `margin` behind it.
    """
    c, s = cos(pose[2]), sin(pose[2])
    lx = pose[0] + c * origin[0] - s * origin[1]
    ly = pose[1] + s * origin[0] + c * origin[1]
    turn = pose[2] + heading
    n = len(ranges)
    agree, contradict = 0, 0
    for k in range(len(surfels)):
        dx, dy = surfels[k, 0] - lx, surfels[k, 1] - ly
        d = hypot(dx, dy)
        if d < 0.3 or d > near:
            continue
        # only surfaces seen from their front and not too flat
        if (dx * surfels[k, 2] + dy * surfels[k, 3]) > -0.25 * d:
            continue
        bearing = atan2(dy, dx) - turn
        bearing -= 2.0 * pi * floor((bearing - bearing0 + resolution) / (2.0 * pi))
        b = int(floor((bearing - bearing0) / resolution + 0.5))
        if b < 1 or b >= n - 1:
            continue
        behind, at = 0, 0
        for q in range(b - 1, b + 2):
            r = ranges[q]
            if r != r:
                continue
            if abs(r - d) <= margin:
                at += 1
            elif r > d + margin:
                behind += 1
        if at > 0:
            agree += 1
        elif behind == 3:
            contradict += 1
    return agree, contradict
