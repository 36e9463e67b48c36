"""Compiled loops from the moments of neighbourhoods to the normals of surfaces."""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled
from iceg.ice._noise_kernels import RangeNoise
from iceg.ice._surface_kernels import Moments, Surfaces

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

_THICKEST = 0.1
"""Neighbours are a line where their variance across is at most this share of that along, noise left out of both."""
_LINE = 2
"""Steps from the first to the last point of a surface that may be a line."""
_PART = 2
"""Steps from the first to the last point of a part of a neighbourhood that may give a normal."""
_PARTS = ((2, 0), (0, 2), (1, 1), (1, 0), (0, 1))
"""Parts of a neighbourhood: so many halves of what lies before a point, and after it."""
_MOSTLY_SLIM = 0.5
"""Share of the points on what is slim from which on it may face the laser."""
FLATTEST2 = 0.02
"""Of what is seen flat the noise across it is no smaller than this share of the ranges' variance: a normal errs."""


class Evenness(NamedTuple):
    """When neighbours lie on one surface.

    Attributes:
        roughness: standard deviation of a surface about its line [m].
        factor: so many times their variance by noise and roughness may be that about their line.
    """

    roughness: float
    factor: float


@compiled
def _normals(moments: Moments, n: int, points: F64, origin: F64, normals: F64) -> None:
    """Normals of the lines through n neighbourhoods, against the ray to each point; 0, 0 where they are no line."""
    count, xx, xy, yy = moments.n[:n], moments.xx[:n], moments.xy[:n], moments.yy[:n]
    _centre(count, moments.x, moments.y, xx, xy, yy)
    _least_spread(count, xx, xy, yy, moments.noise)
    _turn_to_laser(xx, xy, count, points, origin[0], origin[1], normals)


@compiled
def _centre(n: F64, x: F64, y: F64, xx: F64, xy: F64, yy: F64) -> None:
    """Sums of x, y become means, those of xx, xy, yy variances."""
    for i in range(len(n)):
        mx, my = x[i] / n[i], y[i] / n[i]
        x[i], y[i] = mx, my
        xx[i] = xx[i] / n[i] - mx * mx
        xy[i] = xy[i] / n[i] - mx * my
        yy[i] = yy[i] / n[i] - my * my


@compiled
def _least_spread(n: F64, xx: F64, xy: F64, yy: F64, noise: F64) -> None:
    """Along which direction points spread least: its x, y in the place of xx, xy, and how much in that of yy.

    In the place of n comes the length of that direction. It is 0 where the points are too few, or no line but for the
    noise of their ranges.
    """
    for i in range(len(n)):
        small, large, x, y, length = _principal(xx[i], xy[i], yy[i])
        is_line = (n[i] >= 3.0) & (large > 0.0) & (small - noise[i] <= _THICKEST * (large - noise[i]))
        xx[i], xy[i], yy[i] = x, y, small
        n[i] = length if is_line else 0.0


@compiled
def _principal(xx: float, xy: float, yy: float) -> tuple[float, float, float, float, float]:
    """Smaller and larger eigenvalue of a covariance, and the smaller one's eigenvector x, y with its length."""
    half, difference = 0.5 * (xx + yy), xx - yy
    root = sqrt(0.25 * (difference * difference) + xy * xy)
    small = half - root
    # From the better conditioned row.
    ax, ay, bx, by = xy, small - xx, small - yy, xy
    is_worse = ax * ax + ay * ay < bx * bx + by * by
    ax, ay = bx if is_worse else ax, by if is_worse else ay
    length = sqrt(ax * ax + ay * ay)
    is_zero = length < 1e-12
    x = 1.0 if xx < yy else 0.0
    return small, half + root, x if is_zero else ax, 1.0 - x if is_zero else ay, 1.0 if is_zero else length


@compiled
def _turn_to_laser(x: F64, y: F64, lengths: F64, points: F64, x0: float, y0: float, normals: F64) -> None:
    """Unit vectors against the rays to points; 0, 0 for those of length 0."""
    for i in range(len(lengths)):
        away = x[i] * (points[i, 0] - x0) + y[i] * (points[i, 1] - y0)
        length = -lengths[i] if away > 0.0 else lengths[i]
        normals[i, 0] = x[i] / length if length != 0.0 else 0.0
        normals[i, 1] = y[i] / length if length != 0.0 else 0.0


@compiled
def _keep_to_one_surface(
    points: F64,
    origin: F64,
    surfaces: Surfaces,
    before: F64,
    after: F64,
    first: int,
    every: int,
    across: F64,
    noise: RangeNoise,
    even: Evenness,
    normals: F64,
) -> None:
    """Where a neighbourhood is no single surface, the widest part of it that is one gives the normal.

    At a step of a wall, as beside a door in its niche, the line through both surfaces runs slantwise from one to the
    other, and which part of either a scan sees changes with where it stands: such a line goes along with the robot.

    Args:
        points: (n, 2) of a scan: the first, and one in so many after it [m].
        origin: (2,) position of the laser [m].
        surfaces: of all its points.
        before: how many neighbours each of these has before it …
        after: … and after it.
        first: …
        every: …
        across: (n,) variance of the neighbourhood of each about its line [m²].
        noise: of the ranges.
        even: when neighbours are one surface.
        normals: (n, 2) of the lines through whole neighbourhoods; changed in place, 0, 0 where no part is one surface.
    """
    for k in range(len(points)):
        x, y = points[k, 0] - origin[0], points[k, 1] - origin[1]
        nx, ny = normals[k, 0], normals[k, 1]
        if (nx != 0.0 or ny != 0.0) and across[k] <= _unevenness(x, y, nx, ny, noise, even):
            continue
        i = first + k * every
        most_before, most_after = int(before[i]), int(after[i])
        nx, ny, widest = 0.0, 0.0, 0.0
        for half_before, half_after in _PARTS:
            a, b = i - half_before * most_before // 2, i + half_after * most_after // 2
            if b - a < _PART:
                continue
            small, large, ux, uy = _line_through(surfaces.sums, a, b)
            is_line = small <= min(_THICKEST * large, _unevenness(x, y, ux, uy, noise, even))
            if is_line and large > widest:
                nx, ny, widest = ux, uy, large
        is_away = nx * x + ny * y > 0.0
        normals[k, 0], normals[k, 1] = -nx if is_away else nx, -ny if is_away else ny


@compiled
def _unevenness(x: float, y: float, nx: float, ny: float, noise: RangeNoise, even: Evenness) -> float:
    """Largest variance about their line of points of one surface, seen at (x, y) from the laser, its normal (nx, ny).

    Of a laser whose noise nobody knows, it is what is allowed for.
    """
    range2 = x * x + y * y
    toward = nx * x + ny * y
    is_known = noise.constant + noise.per_metre2 > 0.0
    of_range = noise.constant + noise.per_metre2 * range2 if is_known else noise.allowed
    across = max(FLATTEST2, toward * toward / range2) * of_range
    return even.factor * (across + even.roughness * even.roughness)


@compiled
def _line_through(sums: F64, a: int, b: int) -> tuple[float, float, float, float]:
    """Variance across and along the line through the points from a to b, and its unit normal, either way."""
    n = float(b + 1 - a)
    begin, end = sums[a], sums[b + 1]
    mx, my = (end[0] - begin[0]) / n, (end[1] - begin[1]) / n
    xx = (end[2] - begin[2]) / n - mx * mx
    xy = (end[3] - begin[3]) / n - mx * my
    yy = (end[4] - begin[4]) / n - my * my
    small, large, x, y, length = _principal(xx, xy, yy)
    return small, large, x / length, y / length


@compiled
def _face_slim(points: F64, beams: I32, surfaces: Surfaces, n: int, origin: F64, normals: F64) -> None:
    """Where most points lie on things too slim for a line, as trunks and posts, these face the laser: unit vectors.

    They stand before what is beside them. What does not may be a beam that met two surfaces and saw neither.
    """
    x0, y0 = origin[0], origin[1]
    slim = 0
    for i in range(n):
        slim += surfaces.end[i] - surfaces.begin[i] < _LINE
    if slim < _MOSTLY_SLIM * n:
        return
    for i in range(n):
        a, b = surfaces.begin[i], surfaces.end[i]
        if b - a >= _LINE:
            continue
        x, y = x0 - points[i, 0], y0 - points[i, 1]
        nearest2 = x * x + y * y
        before = a == 0 or beams[a] - beams[a - 1] > 1 or _distance2(points[a - 1], x0, y0) > nearest2
        after = b == n - 1 or beams[b + 1] - beams[b] > 1 or _distance2(points[b + 1], x0, y0) > nearest2
        if before and after and nearest2 > 0.0:
            length = sqrt(nearest2)
            normals[i, 0], normals[i, 1] = x / length, y / length


@compiled
def _distance2(point: F64, x0: float, y0: float) -> float:
    dx, dy = point[0] - x0, point[1] - y0
    return float(dx * dx + dy * dy)
