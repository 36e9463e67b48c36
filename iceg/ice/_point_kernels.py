"""Compiled loops from ranges to end points, surface normals and the noise of a scan.

Normals are made stage by stage, for all points together: in loops without branches, over columns, the compiler takes
eight points at once.
"""

from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph._sort_kernels import _sort
from graph.compiled import ONE, ZERO, compiled, compiled_for_both

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

# A surface ends where neighbouring points are farther apart than the jump plus this many beam spacings, and at most so
# far, however many beams between them did not return: the ends of what a laser sees on either side are no wall ahead.
_SPACINGS = 3.0
_WIDEST_GAP = 1.0
_MOST_NEIGHBOURS = 12
"""Most neighbours on either side that give a point its normal; more as it reaches farther for the noise."""
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
_STRETCH = 4
"""Beams to either side that span the chord across which the second difference of a point is taken."""


_JUMP_SIGMAS2 = 25.0
"""Neighbouring points of one surface may lie farther apart by so many of the ranges' variances …"""
_REACH_SIGMAS2 = 16.0
"""… and the neighbourhood that gives a normal reaches farther by as many: the normal of a wall 4 σ to either side, seen
by ten beams, is known to 0.15 rad."""
_FLATTEST2 = 0.02
"""Of what is seen flat the noise across it is no smaller than this share of the ranges' variance: a normal errs."""


class RangeNoise(NamedTuple):
    """How far ranges scatter beyond what all else allows for, see `iceg.ice.noise.NoiseScale`.

    Attributes:
        constant: variance of a short range [m²].
        per_metre2: what it grows by, times the squared range.
        allowed: variance that needs no allowance [m²].
        typical: what is beyond it at the typical range [m²].
    """

    constant: float
    per_metre2: float
    allowed: float
    typical: float


class Evenness(NamedTuple):
    """When neighbours lie on one surface.

    Attributes:
        roughness: standard deviation of a surface about its line [m].
        factor: so many times their variance by noise and roughness may be that about their line.
    """

    roughness: float
    factor: float


@compiled_for_both
def scan_points(
    ranges: F32,
    directions: F64,
    origin: F64,
    reach: float,
    jump: float,
    noise: RangeNoise,
    points: F64,
    normals: F64,
    beams: I32,
    spreads: F64,
) -> int:
    """End points, unit normals towards the laser and beam indices of the beams with a return.

    Args:
        ranges: (n_beams,) [m], NaN without return.
        directions: (n_beams, 2) unit vectors in the robot frame.
        origin: (2,) position of the laser in the robot frame [m].
        reach: neighbours up to this far on either side define the normal of a point [m].
        jump: see `_surfaces` [m].
        noise: of the ranges.
        points: (n_beams, 2) output [m].
        normals: (n_beams, 2) output; 0, 0 where no line fits the neighbourhood, but see `_face_slim`.
        beams: (n_beams,) output.
        spreads: (n_beams,) output, variance of each across its surface in that of a typical point.

    Returns:
        The number of returns.
    """
    n = _returns(ranges, directions, origin, points, beams)
    surfaces, moments = _room_for_surfaces(n), _room_for_moments(n)
    _surfaces(points[:n], beams, origin, _resolution(directions), jump, noise, surfaces)
    before, after = np.empty(n), np.empty(n)
    _neighbourhoods(points[:n], surfaces, reach * reach, before, after)
    _sum_up(surfaces, before, after, ZERO, ONE, n, moments)
    _normals(moments, n, points, origin, normals)
    _face_slim(points, beams, surfaces, n, origin, normals)
    _spread(points[:n], normals, origin, noise, spreads)
    if noise.constant + noise.per_metre2 > 0.0:
        _straighten(points[:n], normals, origin, moments, noise.allowed)
    return n


@compiled
def thinned_points(
    ranges: F32,
    directions: F64,
    origin: F64,
    reach: float,
    jump: float,
    noise: RangeNoise,
    even: Evenness,
    offsets: I64,
    every: int,
    points: F64,
    normals: F64,
    spreads: F64,
    errors: F64,
    starts: I64,
) -> None:
    """As `scan_points`, for many scans of one laser, of each of which only every so many returns are kept.

    What is slim has no normal here, and at a step or corner of a wall only one of its surfaces gives it.

    Args:
        ranges: (m, n_beams) [m], NaN without return.
        directions: see `scan_points`, as the following.
        origin: …
        reach: …
        jump: …
        noise: …
        even: which neighbourhoods are one surface.
        offsets: (m,) the first return of each scan that is kept, below `every`.
        every: one in so many is kept.
        points: (capacity, 2) output [m].
        normals: (capacity, 2) output.
        spreads: (capacity,) output.
        errors: (capacity, 2) output, standard deviation of each beyond what is allowed for, along its beam [m].
        starts: (m + 1,) output: scan k has those from starts[k] to starts[k + 1].
    """
    n_beams = ranges.shape[1]
    resolution = _resolution(directions)
    returns, beams = np.empty((n_beams, 2)), np.empty(n_beams, np.int32)
    surfaces, moments = _room_for_surfaces(n_beams), _room_for_moments(n_beams)
    before, after = np.empty(n_beams), np.empty(n_beams)
    count = 0
    starts[0] = 0
    for scan in range(len(ranges)):
        n = _returns(ranges[scan], directions, origin, returns, beams)
        _surfaces(returns[:n], beams, origin, resolution, jump, noise, surfaces)
        kept = max(0, -((offsets[scan] - n) // every))
        for k in range(kept):
            assign(points[count + k], returns[offsets[scan] + k * every])
        _neighbourhoods(returns[:n], surfaces, reach * reach, before, after)
        _sum_up(surfaces, before, after, offsets[scan], every, kept, moments)
        _normals(moments, kept, points[count:], origin, normals[count:])
        _keep_to_one_surface(
            points[count : count + kept],
            origin,
            surfaces,
            before,
            after,
            offsets[scan],
            every,
            moments.yy,
            noise,
            even,
            normals[count:],
        )
        _spread(points[count : count + kept], normals[count:], origin, noise, spreads[count:])
        _err_along_beams(points[count : count + kept], origin, noise, errors[count:])
        count += kept
        starts[scan + 1] = count


class Surfaces(NamedTuple):
    """Runs of points without a jump.

    Attributes:
        begin: (n,) first point of the surface that each point lies on.
        end: (n,) last one.
        ends: (n,) whether a surface ends before each point.
        sums: (n + 1, 5) of x, y, xx, xy, yy relative to the laser, up to each point: the moments of any stretch are two
            look-ups.
        noise: (n,) variance of the range of each beyond what is allowed for [m²].
    """

    begin: I32
    end: I32
    ends: Bool
    sums: F64
    noise: F64


class Moments(NamedTuple):
    """(n,) each: number of points around each point, and their sums of x, y, xx, xy, yy; worked on in place.

    And the variance of its range beyond what is allowed for [m²].
    """

    n: F64
    x: F64
    y: F64
    xx: F64
    xy: F64
    yy: F64
    noise: F64


@compiled
def _room_for_surfaces(n: int) -> Surfaces:
    return Surfaces(
        np.empty(n, np.int32), np.empty(n, np.int32), np.zeros(n, np.bool_), np.empty((n + 1, 5)), np.empty(n)
    )


@compiled
def _room_for_moments(n: int) -> Moments:
    return Moments(np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))


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
def _beyond(range2: float, noise: RangeNoise) -> float:
    """Variance of a range, given squared, beyond what is allowed for [m²]."""
    return max(0.0, noise.constant + noise.per_metre2 * range2 - noise.allowed)


@compiled
def _spread(points: F64, normals: F64, origin: F64, noise: RangeNoise, spreads: F64) -> None:
    """Variance of points (n, 2) across their surfaces in that of a typical one; a range errs along its beam."""
    x0, y0, usual = origin[0], origin[1], noise.allowed + noise.typical
    for i in range(len(points)):
        x, y = points[i, 0] - x0, points[i, 1] - y0
        range2 = x * x + y * y
        across = normals[i, 0] * x + normals[i, 1] * y
        has_normal = (normals[i, 0] != 0.0) | (normals[i, 1] != 0.0)
        share = max(_FLATTEST2, across * across / range2) if has_normal else 1.0
        spreads[i] = (noise.allowed + share * _beyond(range2, noise)) / usual


@compiled
def _err_along_beams(points: F64, origin: F64, noise: RangeNoise, errors: F64) -> None:
    """Standard deviation of points (n, 2) beyond what is allowed for, along their beams [m]."""
    for i in range(len(points)):
        x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
        range2 = x * x + y * y
        share = sqrt(_beyond(range2, noise) / max(range2, 1e-12))
        errors[i, 0], errors[i, 1] = share * x, share * y


@compiled
def _surfaces(
    points: F64, beams: I32, origin: F64, resolution: float, jump: float, noise: RangeNoise, surfaces: Surfaces
) -> None:
    """Find where surfaces end, and sum up their points."""
    x0, y0, ends = origin[0], origin[1], surfaces.ends
    for i in range(len(points)):
        x, y = points[i, 0] - x0, points[i, 1] - y0
        surfaces.noise[i] = _beyond(x * x + y * y, noise)
    for i in range(1, len(points)):
        x, y = points[i, 0] - x0, points[i, 1] - y0
        spacing = resolution * sqrt(x * x + y * y) * (beams[i] - beams[i - 1])
        gap = min(_WIDEST_GAP, jump + _SPACINGS * spacing)
        dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        ends[i] = dx * dx + dy * dy > gap * gap + _JUMP_SIGMAS2 * max(surfaces.noise[i], surfaces.noise[i - 1])
    surfaces.sums[0] = 0.0
    sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0
    start = 0
    for i in range(len(points)):
        x, y = points[i, 0] - x0, points[i, 1] - y0
        sx, sy, sxx, sxy, syy = sx + x, sy + y, sxx + x * x, sxy + x * y, syy + y * y
        row = surfaces.sums[i + 1]
        row[0], row[1], row[2], row[3], row[4] = sx, sy, sxx, sxy, syy
        if i > 0 and ends[i]:
            surfaces.end[start:i] = i - 1
            start = i
        surfaces.begin[i] = start
    surfaces.end[start : len(points)] = len(points) - 1


@compiled
def _sum_up(surfaces: Surfaces, before: F64, after: F64, first: int, every: int, n: int, moments: Moments) -> None:
    """Moments of n neighbourhoods, so many points before and after each: the first, and one in so many after it."""
    sums = surfaces.sums
    for k in range(n):
        i = first + k * every
        a, b = i - int(before[i]), i + int(after[i])
        moments.noise[k] = surfaces.noise[i]
        begin, end = sums[a], sums[b + 1]
        moments.n[k] = b + 1 - a
        moments.x[k], moments.y[k] = end[0] - begin[0], end[1] - begin[1]
        moments.xx[k], moments.xy[k], moments.yy[k] = end[2] - begin[2], end[3] - begin[3], end[4] - begin[4]


@compiled
def _neighbourhoods(points: F64, surfaces: Surfaces, reach2: float, before: F64, after: F64) -> None:
    """How many points before and after each are its neighbours: of its surface, to the first one beyond the reach.

    Those next to it count however far they are, and more than some do not: see `_MOST_NEIGHBOURS`.
    """
    n, widest = len(points), 0
    x, y, wide2, squares = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        x[i], y[i] = points[i, 0], points[i, 1]
        wide2[i] = reach2 + _REACH_SIGMAS2 * surfaces.noise[i]
        most = int(_MOST_NEIGHBOURS * sqrt(wide2[i] / reach2))
        before[i], after[i] = min(most, i - surfaces.begin[i]), min(most, surfaces.end[i] - i)
        widest = max(widest, most)
    for away in range(2, min(widest + 1, n)):
        _distances2(x[:-away], y[:-away], x[away:], y[away:], squares)
        _end_at(squares, wide2[:-away], float(away), after)
        _end_at(squares, wide2[away:], float(away), before[away:])


@compiled
def _distances2(x: F64, y: F64, u: F64, v: F64, squares: F64) -> None:
    """Squared distances of points (x, y) from others (u, v)."""
    for i in range(len(x)):
        dx, dy = u[i] - x[i], v[i] - y[i]
        squares[i] = dx * dx + dy * dy


@compiled
def _end_at(squares: F64, wide2: F64, away: float, steps: F64) -> None:
    """No more steps than up to the neighbour so many away where that one lies beyond the reach."""
    for i in range(len(wide2)):
        steps[i] = min(steps[i], away if squares[i] >= wide2[i] else np.inf)


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
        cxx, cxy, cyy = xx[i], xy[i], yy[i]
        half, difference = 0.5 * (cxx + cyy), cxx - cyy
        root = sqrt(0.25 * (difference * difference) + cxy * cxy)
        small, large = half - root, half + root
        is_line = (n[i] >= 3.0) & (large > 0.0) & (small - noise[i] <= _THICKEST * (large - noise[i]))
        # Eigenvector of the smaller eigenvalue, from the better conditioned row.
        ax, ay, bx, by = cxy, small - cxx, small - cyy, cxy
        is_worse = ax * ax + ay * ay < bx * bx + by * by
        ax, ay = bx if is_worse else ax, by if is_worse else ay
        length = sqrt(ax * ax + ay * ay)
        across = 1.0 if cxx < cyy else 0.0
        is_zero = length < 1e-12
        xx[i] = across if is_zero else ax
        xy[i] = 1.0 - across if is_zero else ay
        length = 1.0 if is_zero else length
        n[i] = length if is_line else 0.0
        yy[i] = small


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
    across = max(_FLATTEST2, toward * toward / range2) * of_range
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
    half, difference = 0.5 * (xx + yy), xx - yy
    root = sqrt(0.25 * (difference * difference) + xy * xy)
    small, large = half - root, half + root
    ax, ay, bx, by = xy, small - xx, small - yy, xy
    if ax * ax + ay * ay < bx * bx + by * by:
        ax, ay = bx, by
    length = sqrt(ax * ax + ay * ay)
    if length < 1e-12:
        return small, large, 1.0 if xx < yy else 0.0, 0.0 if xx < yy else 1.0
    return small, large, ax / length, ay / length


@compiled
def _straighten(points: F64, normals: F64, origin: F64, moments: Moments, allowed: float) -> None:
    """Put points (n, 2) onto the lines that gave them their normals, as far as what has them off is noise.

    Noise beyond what is allowed for takes a point to the wrong surface; what its neighbours know of its surface is not
    lost by that.
    """
    for i in range(len(points)):
        x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
        off = normals[i, 0] * (x - moments.x[i]) + normals[i, 1] * (y - moments.y[i])
        share = moments.noise[i] / (moments.noise[i] + allowed)
        points[i, 0] -= share * off * normals[i, 0]
        points[i, 1] -= share * off * normals[i, 1]


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


@compiled
def _count_returns(ranges: F32, near: float) -> tuple[int, int]:
    """How many beams returned, and how many of these from nearer than `near` [m]."""
    returns, close = 0, 0
    for b in range(len(ranges)):
        returns += ranges[b] >= 0.0
        close += ranges[b] < near
    return returns, close


@compiled_for_both
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
    _sort(off[:count])
    median: float = 0.5 * (off[(count - 1) // 2] + off[count // 2])
    return median / (0.6745 * sqrt(6.0))
