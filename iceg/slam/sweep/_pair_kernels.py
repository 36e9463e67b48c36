"""Compiled loops that lay two scans over each other, each beam at its own time, and ask how long a sweep takes."""

from math import atan2, cos, floor, hypot, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled
from iceg.slam.sweep._deskew_kernels import _pose_within, _wrapped

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Laser(NamedTuple):
    """The beams.

    Attributes:
        bearings: (n_beams,) evenly spread [rad].
        full: whether the first beam follows the last one.
        velocity: (n, 3) of the laser within each scan, see `MotionWithin`.
        change: (n, 3).
    """

    bearings: F64
    full: bool
    velocity: F64
    change: F64


class Fit(NamedTuple):
    """How two scans are laid over each other.

    Attributes:
        gate: points farther from the surface than this do not belong to it [m].
        scale: width of the Cauchy weight of a point [m].
        every: one in so many points takes part.
        half: neighbours on either side of a point that make its surface.
        steps: Gauss-Newton steps of the pose.
        least: points that must find their surface.
    """

    gate: float
    scale: float
    every: int
    half: int
    steps: int
    least: int


@compiled
def reduced_information(
    ranges: F32, pairs: I64, T_one_other: F64, laser: Laser, share: float, fit: Fit, about: F64
) -> None:
    """What each pair of scans tells of the sweep once the pose between them is what suits it best.

    Residuals are distances of the points of one scan from the surfaces of the other. Both scans are bent by the sweep,
    and both derivatives with respect to it count.

    Args:
        ranges: (n, n_beams) as measured [m], NaN without return.
        pairs: (m, 2) which scans.
        T_one_other: (m, 3) laser of the second in the frame of the first; improved in place.
        laser: its beams, and its motion within each scan.
        share: the sweep in intervals, signed; the residuals are linearised here.
        fit: how scans are laid over each other.
        about: (m, 2) output: information and gradient of the sweep; 0 where the scans do not overlap.
    """
    n_beams = len(laser.bearings)
    one, d_one, normals = np.empty((n_beams, 2)), np.empty((n_beams, 2)), np.empty((n_beams, 2))
    other, d_other = np.empty((n_beams, 2)), np.empty((n_beams, 2))
    system = np.empty((4, 5))
    for m in range(len(pairs)):
        i, j = pairs[m]
        _bent_points(ranges[i], laser.bearings, laser.velocity[i], laser.change[i], share, one, d_one)
        _bent_points(ranges[j], laser.bearings, laser.velocity[j], laser.change[j], share, other, d_other)
        _surface_normals(one, fit.half, laser.full, normals)
        shifted = abs(share) * (abs(laser.velocity[i, 2]) + abs(laser.velocity[j, 2]))
        about[m] = 0.0
        for step in range(fit.steps):
            n = _lay_over(one, d_one, normals, other, d_other, T_one_other[m], laser, shifted, fit, system)
            if n < fit.least:
                break
            _eliminate_pose(system)
            if step == fit.steps - 1:
                about[m, 0], about[m, 1] = system[3, 3], system[3, 4]
            _move(T_one_other[m], system)


@compiled
def _bent_points(
    ranges: F32, bearings: F64, velocity: F64, change: F64, share: float, points: F64, derivative: F64
) -> None:
    """End points in the frame of the laser in the middle of the sweep, and their derivatives by the sweep.

    Args:
        ranges: (n_beams,) [m], NaN without return.
        bearings: (n_beams,) [rad].
        velocity: (3,) of the laser per interval.
        change: (3,) of it.
        share: the sweep in intervals.
        points: (n_beams, 2) output [m]; NaN without return.
        derivative: (n_beams, 2) output [m per interval].
    """
    n_beams = len(bearings)
    for b in range(n_beams):
        phase = b / (n_beams - 1) - 0.5
        tau = share * phase
        x, y, turn = _pose_within(velocity, change, tau)
        c, s = cos(bearings[b] + turn), sin(bearings[b] + turn)
        points[b, 0], points[b, 1] = x + ranges[b] * c, y + ranges[b] * s
        rate = phase * (velocity[2] + change[2] * tau)
        derivative[b, 0] = phase * (velocity[0] + change[0] * tau) - rate * points[b, 1]
        derivative[b, 1] = phase * (velocity[1] + change[1] * tau) + rate * points[b, 0]


@compiled
def _surface_normals(points: F64, half: int, full: bool, normals: F64) -> None:
    """Normals of the chord through the neighbours of each point; NaN where these are not on one line with it."""
    n = len(points)
    for i in range(n):
        normals[i] = np.nan
        if not full and (i < half or i >= n - half):
            continue
        a, b = (i - half) % n, (i + half) % n
        dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        length = hypot(dx, dy)
        along = (points[i, 0] - points[a, 0]) * dx + (points[i, 1] - points[a, 1]) * dy
        across = (points[i, 1] - points[a, 1]) * dx - (points[i, 0] - points[a, 0]) * dy
        if abs(across) < 0.1 * length * length and 0.2 < along / (length * length) < 0.8:
            normals[i, 0], normals[i, 1] = -dy / length, dx / length


@compiled
def _lay_over(
    one: F64,
    d_one: F64,
    normals: F64,
    other: F64,
    d_other: F64,
    T_one_other: F64,
    laser: Laser,
    shifted: float,
    fit: Fit,
    system: F64,
) -> int:
    """Normal equations of pose and sweep, (4, 5) with the gradient last; how many points took part."""
    n_beams = len(one)
    first, resolution = laser.bearings[0], (laser.bearings[n_beams - 1] - laser.bearings[0]) / (n_beams - 1)
    c, s = cos(T_one_other[2]), sin(T_one_other[2])
    row = np.empty(4)
    system[:] = 0.0
    n = 0
    for k in range(0, n_beams, fit.every):
        if np.isnan(other[k, 0]):
            continue
        rx, ry = c * other[k, 0] - s * other[k, 1], s * other[k, 0] + c * other[k, 1]
        x, y = T_one_other[0] + rx, T_one_other[1] + ry
        beam = floor((atan2(y, x) - first) / resolution + 0.5)
        within = int((fit.gate / max(hypot(x, y), fit.gate) + 0.5 * shifted) / resolution) + 1
        found, nearest2 = -1, fit.gate * fit.gate
        for at in range(beam - within, beam + within + 1):
            b = at % n_beams if laser.full else at
            if 0 <= b < n_beams:
                dx, dy = x - one[b, 0], y - one[b, 1]
                if dx * dx + dy * dy < nearest2:
                    found, nearest2 = b, dx * dx + dy * dy
        if found < 0 or np.isnan(normals[found, 0]):
            continue
        nx, ny = normals[found, 0], normals[found, 1]
        residual = nx * (x - one[found, 0]) + ny * (y - one[found, 1])
        bx, by = c * d_other[k, 0] - s * d_other[k, 1], s * d_other[k, 0] + c * d_other[k, 1]
        row[0], row[1], row[2] = nx, ny, ny * rx - nx * ry
        row[3] = nx * (bx - d_one[found, 0]) + ny * (by - d_one[found, 1])
        weight = 1.0 / (1.0 + residual * residual / (fit.scale * fit.scale))
        for a in range(4):
            for b in range(a, 4):
                system[a, b] += weight * row[a] * row[b]
            system[a, 4] -= weight * row[a] * residual
        n += 1
    for a in range(4):
        for b in range(a):
            system[a, b] = system[b, a]
    return n


@compiled
def _eliminate_pose(system: F64) -> None:
    """Eliminate the first three unknowns; what is left in the last row is the sweep's information and gradient."""
    for a in range(3):
        system[a, a] += 1.0  # no direction is quite unknown: the track holds it
        for b in range(a + 1, 4):
            factor = system[b, a] / system[a, a]
            for k in range(a, 5):
                system[b, k] -= factor * system[a, k]


@compiled
def _move(T_one_other: F64, system: F64) -> None:
    """Solve for the pose with the sweep as it is, and move it."""
    turn = system[2, 4] / system[2, 2]
    y = (system[1, 4] - system[1, 2] * turn) / system[1, 1]
    x = (system[0, 4] - system[0, 1] * y - system[0, 2] * turn) / system[0, 0]
    T_one_other[0] += x
    T_one_other[1] += y
    T_one_other[2] = _wrapped(T_one_other[2] + turn)
