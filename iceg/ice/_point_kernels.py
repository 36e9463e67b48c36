"""Compiled loops from the ranges of scans to end points, the normals of their surfaces and how far they err."""

from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph.compiled import ONE, ZERO, compiled, compiled_for_both
from iceg.ice._noise_kernels import RangeNoise, _beyond
from iceg.ice._normal_kernels import FLATTEST2, Evenness, _face_slim, _keep_to_one_surface, _normals
from iceg.ice._surface_kernels import (
    Moments,
    _neighbourhoods,
    _room_for_moments,
    _room_for_surfaces,
    _sum_up,
    _surfaces,
)

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]


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
def _spread(points: F64, normals: F64, origin: F64, noise: RangeNoise, spreads: F64) -> None:
    """Variance of points (n, 2) across their surfaces in that of a typical one; a range errs along its beam."""
    x0, y0, usual = origin[0], origin[1], noise.allowed + noise.typical
    for i in range(len(points)):
        x, y = points[i, 0] - x0, points[i, 1] - y0
        range2 = x * x + y * y
        across = normals[i, 0] * x + normals[i, 1] * y
        has_normal = (normals[i, 0] != 0.0) | (normals[i, 1] != 0.0)
        share = max(FLATTEST2, across * across / range2) if has_normal else 1.0
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
def _count_returns(ranges: F32, near: float) -> tuple[int, int]:
    """How many beams returned, and how many of these from nearer than `near` [m]."""
    returns, close = 0, 0
    for b in range(len(ranges)):
        returns += ranges[b] >= 0.0
        close += ranges[b] < near
    return returns, close
