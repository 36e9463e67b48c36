"""Compiled loops that weigh the poses around an optimum: what the points of a scan say of its uncertainty."""

from math import cos, exp, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled
from iceg.ice._held_kernels import _held, _lengths
from iceg.ice._refinement_kernels import partner
from iceg.ice._score_grid_kernels import score_grid
from iceg.ice._telling_kernels import beyond_end
from iceg.ice.scored import Scored

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_FEWEST_TELLING = 10
"""Points that tell nothing are left out where at least so many tell something."""
_LAGS = 12
"""Residuals of beams no farther apart than this may be correlated."""
_CHANCE = 3
"""What so few points say of a direction is chance."""
_LEAST_KNOWN = 1e-3
"""Share of what is told that is known at least."""
_TELLING = 10.0
"""So many points must hold a direction for their own residuals to count as much as those of all."""


class Reading(NamedTuple):
    """How scores around an optimum are taken and read.

    Attributes:
        n_picks: how many of the points are used for the scores at most.
        sigma: standard deviation of a residual [m].
        least_variance: of the residuals of points that hold one direction [m²].
        limit: residuals beyond this tell of something else [m].
        independence: share of the points that count as independent where neighbouring residuals are uncorrelated.
        temperature: the scores are flattened by it, their second moment is divided by it.
        spacing: of the grid, in standard deviations of the flattened Hessian's Gaussian.
        min_step: least spacing [m or rad] …
        max_step: … and largest.
        edge_mass: with more weight than this on the edge of the largest grid a direction is unobservable.
        weak_sigma: standard deviation it is given [m or rad].
    """

    n_picks: int
    sigma: float
    least_variance: float
    limit: float
    independence: float
    temperature: float
    spacing: float
    min_step: float
    max_step: float
    edge_mass: float
    weak_sigma: float


class Weighed(NamedTuple):
    """What scores tell of an optimum, filled in by `score_covariance`.

    Attributes:
        covariance: (3, 3) second moment of the scores, tangent space of the robot, larger along each axis by `ratios`.
        axes: (3, 3) columns: principal directions of the grid.
        steps: (3,) its spacing along each.
        weights: (side, side, side) normalised scores on the grid.
        weak: (3,) which axes are unobservable.
        ratios: (3,) see `_unevenness` and `_pretence`; 1 where unobservable.
        directions: (2, 3) of the position and the turns that go along, see `_held_kernels._held`, …
        held: (2,) … and by how much wall they are held [m].
    """

    covariance: F64
    axes: F64
    steps: F64
    weights: F64
    weak: Bool
    ratios: F64
    directions: F64
    held: F64

    @classmethod
    def empty(cls, side: int) -> "Weighed":
        """With room for a grid of so many poses along each axis."""
        return cls(
            np.empty((3, 3)),
            np.empty((3, 3)),
            np.empty(3),
            np.empty((side, side, side)),
            np.empty(3, np.bool_),
            np.empty(3),
            np.empty((2, 3)),
            np.empty(2),
        )


class Residuals(NamedTuple):
    """How points lie on their surfels at one pose, after `_LAGS` rows of zeros; zeros for points that tell nothing.

    Attributes:
        distances: (12 + n,) from the surfels' lines [m], in units of each point's spread, as all else.
        levers: (12 + n, 3) their derivatives by a step of the robot in its own frame …
        own_levers: (12 + n, 3) … and by the points' own normals, in the place of the surfels'.
        used: how many points tell something.
        hessian: (3, 3) Σ w JᵀJ of all points with a surfel, Cauchy weights, tangent space of the robot.
    """

    distances: F64
    levers: F64
    own_levers: F64
    used: int
    hessian: F64


@compiled
def _residuals_at(scored: Scored, pose: F64, limit: float) -> Residuals:
    """The residuals at a pose (3,); those of `limit` or more tell of something else [m]."""
    points, normals, surfels, origin = scored.points, scored.normals, scored.surfels, scored.origin
    n = len(points)
    distances, levers, used = np.zeros(_LAGS + n), np.zeros((_LAGS + n, 3)), 0
    own_levers = np.zeros((_LAGS + n, 3))
    hessian, inverse_scale2 = np.zeros((3, 3)), 1.0 / (scored.scale * scored.scale)
    c, s = cos(pose[2]), sin(pose[2])
    for i in range(n):
        px, py = points[i, 0], points[i, 1]
        x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        nx, ny = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
        k = partner(x, y, nx, ny, surfels, scored.nearest, origin[0], origin[1], 1.0 / scored.cell, scored.facing)
        if k < 0:
            continue
        mx, my = surfels[k, 2], surfels[k, 3]
        r = mx * (x - surfels[k, 0]) + my * (y - surfels[k, 1])
        jx, jy = c * mx + s * my, c * my - s * mx
        turn, w = jy * px - jx * py, 1.0 / (scored.spreads[i] + r * r * inverse_scale2)
        hessian[0, 0] += w * jx * jx
        hessian[0, 1] += w * jx * jy
        hessian[0, 2] += w * jx * turn
        hessian[1, 1] += w * jy * jy
        hessian[1, 2] += w * jy * turn
        hessian[2, 2] += w * turn * turn
        typically = 1.0 / sqrt(scored.spreads[i])
        r *= typically
        if abs(r) >= limit:
            continue
        distances[_LAGS + i] = r
        levers[_LAGS + i, 0], levers[_LAGS + i, 1] = typically * jx, typically * jy
        levers[_LAGS + i, 2] = typically * turn
        if normals[i, 0] != 0.0 or normals[i, 1] != 0.0:
            jx, jy = normals[i, 0], normals[i, 1]
            turn = jy * px - jx * py
        own_levers[_LAGS + i, 0], own_levers[_LAGS + i, 1] = typically * jx, typically * jy
        own_levers[_LAGS + i, 2] = typically * turn
        used += 1
    hessian[1, 0], hessian[2, 0], hessian[2, 1] = hessian[0, 1], hessian[0, 2], hessian[1, 2]
    return Residuals(distances, levers, own_levers, used, hessian)


@compiled
def _shared(values: F64) -> float:
    """Σ (1 - l/13) Σ vᵢ vᵢ₋ₗ over the lags l = 1..12 of values that begin with 12 zeros."""
    total = 0.0
    for lag in range(1, _LAGS + 1, 4):
        # Four sums at a time: none has to wait for another.
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for i in range(_LAGS, len(values)):
            v = values[i]
            a += v * values[i - lag]
            b += v * values[i - lag - 1]
            c += v * values[i - lag - 2]
            d += v * values[i - lag - 3]
        total += (1.0 - lag / (_LAGS + 1.0)) * a
        total += (1.0 - (lag + 1) / (_LAGS + 1.0)) * b
        total += (1.0 - (lag + 2) / (_LAGS + 1.0)) * c
        total += (1.0 - (lag + 3) / (_LAGS + 1.0)) * d
    return total


@compiled
def _dependence(found: Residuals) -> float:
    """How many neighbouring points say the same: 1 + 2 Σ (1 - l/13) ρ_l over the lags l = 1..12, at least 1.

    ρ_l is the correlation of the residuals of points l apart.
    """
    squares = 0.0
    for r in found.distances:
        squares += r * r
    if found.used < 2 * _LAGS or squares <= 0.0:
        return 1.0
    return max(1.0, 1.0 + 2.0 * _shared(found.distances) / squares)


@compiled
def _unevenness(found: Residuals, axes: F64, least: float, variance: float, ratios: F64) -> None:
    """How much larger the variance along each axis is than if every point were off by the same `variance`.

    A direction is known as well as the points that hold it: those of a wall far ahead scatter more than those of the
    walls beside. Along an axis v point i pulls with gᵢ = rᵢ Jᵢv; White's and Newey's (1987) estimate takes Σ gᵢ², and
    what neighbours share, in the place of variance · Σ (Jᵢv)². Where few points hold the axis they are too few to tell
    and the ratio keeps near 1.

    Args:
        found: residuals at the optimum.
        axes: (3, 3) columns, in the tangent space of the robot.
        least: a residual's variance is never taken to be smaller [m²].
        variance: of a residual, times how many neighbours say the same [m²].
        ratios: (3,) output.
    """
    distances, levers = found.distances, found.levers
    pulls = np.empty(len(distances))
    for a in range(3):
        squares, fourth, meat = 0.0, 0.0, 0.0
        for i in range(len(pulls)):
            lever = levers[i, 0] * axes[0, a] + levers[i, 1] * axes[1, a] + levers[i, 2] * axes[2, a]
            pulls[i] = distances[i] * lever
            lever2 = lever * lever
            squares += lever2
            fourth += lever2 * lever2
            meat += pulls[i] * pulls[i]
        if squares <= 0.0:
            ratios[a] = 1.0
            continue
        meat = max(meat + 2.0 * max(_shared(pulls), 0.0), least * squares)
        held_by = squares * squares / fourth
        ratios[a] = (_TELLING + held_by * meat / (variance * squares)) / (_TELLING + held_by)


@compiled
def _pretence(found: Residuals, axis: F64) -> float:
    """How many times less is known along an axis v than Σ (Jv)² over the surfels' normals pretends; at least 1.

    A wall along which a scan slides does not hold it, be it straight or, v being a turn about its centre, curved. But
    the normals of its surfels err by a few degrees, and in the sum their errors count as if the wall were rough. Those
    of the scan's own normals are others: in Σ (Jv)(J'v), one factor of either, they cancel. And what rests on
    `_CHANCE` points rests on chance: at the edge of a door a normal is of no surface, and where the edge seems to be
    depends on where the beams go. So the largest shares are left out.
    """
    told, crossed = 0.0, 0.0
    most = np.zeros(_CHANCE)
    for i in range(len(found.levers)):
        lever, own = 0.0, 0.0
        for a in range(3):
            lever += found.levers[i, a] * axis[a]
            own += found.own_levers[i, a] * axis[a]
        told += lever * lever
        share = lever * own
        crossed += share
        k = _CHANCE - 1
        if share > most[k]:
            while k > 0 and most[k - 1] < share:
                most[k] = most[k - 1]
                k -= 1
            most[k] = share
    for share in most:
        crossed -= share
    return max(1.0, told / max(crossed, _LEAST_KNOWN * told, 1e-12))


@compiled
def _principal_axes(matrix: F64, values: F64, axes: F64) -> None:
    """Eigenvalues and eigenvectors (columns) of a symmetric 3×3 matrix, by Jacobi rotations."""
    a = matrix.copy()
    axes[:] = 0.0
    axes[0, 0], axes[1, 1], axes[2, 2] = 1.0, 1.0, 1.0
    for _ in range(30):
        p, q = 0, 1
        if abs(a[0, 2]) > abs(a[p, q]):
            p, q = 0, 2
        if abs(a[1, 2]) > abs(a[p, q]):
            p, q = 1, 2
        if abs(a[p, q]) <= 1e-14 * (abs(a[p, p]) + abs(a[q, q])):
            break
        theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
        t = 1.0 / (abs(theta) + sqrt(theta * theta + 1.0))
        if theta < 0.0:
            t = -t
        c = 1.0 / sqrt(t * t + 1.0)
        s = t * c
        for k in range(3):
            kp, kq = a[k, p], a[k, q]
            a[k, p], a[k, q] = c * kp - s * kq, s * kp + c * kq
        for k in range(3):
            pk, qk = a[p, k], a[q, k]
            a[p, k], a[q, k] = c * pk - s * qk, s * pk + c * qk
            kp, kq = axes[k, p], axes[k, q]
            axes[k, p], axes[k, q] = c * kp - s * kq, s * kp + c * kq
    for k in range(3):
        values[k] = a[k, k]


@compiled
def _moments(costs: F64, best: float, per_cost: float, steps: F64, second: F64, edges: F64) -> None:
    """Turn costs into normalised weights exp(-per_cost·(cost - best)), in place, and take their central second moment.

    Args:
        costs: (side, side, side); becomes the weights.
        best: the smallest cost.
        per_cost: how much a cost counts.
        steps: (3,) spacing of the grid.
        second: (3, 3) output: K/s - uuᵀ/s² along the axes of the grid, a cell's own width included.
        edges: (3,) output: weight on the two outermost layers across each axis.
    """
    side = costs.shape[0]
    half = side // 2
    total = 0.0
    mean = np.zeros(3)
    second[:] = 0.0
    edges[:] = 0.0
    g = np.empty(3)
    for i0 in range(side):
        for i1 in range(side):
            for i2 in range(side):
                w = exp(-per_cost * (costs[i0, i1, i2] - best))
                costs[i0, i1, i2] = w
                total += w
                g[0], g[1], g[2] = (i0 - half) * steps[0], (i1 - half) * steps[1], (i2 - half) * steps[2]
                for a in range(3):
                    mean[a] += w * g[a]
                    for b in range(3):
                        second[a, b] += w * g[a] * g[b]
                edges[0] += w if i0 == 0 or i0 == side - 1 else 0.0
                edges[1] += w if i1 == 0 or i1 == side - 1 else 0.0
                edges[2] += w if i2 == 0 or i2 == side - 1 else 0.0
    for a in range(3):
        for b in range(3):
            second[a, b] = second[a, b] / total - mean[a] * mean[b] / (total * total)
        second[a, a] += steps[a] * steps[a] / 12.0
        edges[a] /= total
    costs /= total


@compiled
def score_covariance(scored: Scored, pose: F64, reading: Reading, out: Weighed) -> None:
    """Second moment of the scores around an optimum, on a grid along the principal axes of its Hessian.

    Args:
        scored: the points and the reference.
        pose: (3,) the optimum.
        reading: how the scores are taken and read.
        out: output.
    """
    scored = _telling(scored, pose)
    n_picks = min(len(scored.points), reading.n_picks)
    found = _residuals_at(scored, pose, reading.limit)
    repeated = _dependence(found)
    share = reading.independence / repeated
    precision = share / (reading.temperature * reading.sigma * reading.sigma)
    _lay_grid(found.hessian, precision, reading, out)
    best = score_grid(scored, n_picks, pose, out.axes, out.steps, out.weights)
    sigmas = scored.scale / reading.sigma
    per_point = 0.5 * (sigmas * sigmas) * share / reading.temperature
    edges, second, side = np.empty(3), np.empty((3, 3)), len(out.weights)
    _moments(out.weights, best, per_point * len(scored.points) / n_picks, out.steps, second, edges)
    second /= reading.temperature
    variance = reading.sigma * reading.sigma * repeated
    reach = side // 2 * reading.max_step
    _unevenness(found, out.axes, reading.least_variance, variance, out.ratios)
    for a in range(3):
        out.ratios[a] *= _pretence(found, out.axes[:, a])
        beyond = second[a, a] * out.ratios[a] > reach * reach
        out.weak[a] = beyond or (edges[a] > reading.edge_mass and out.steps[a] >= 0.999 * reading.max_step)
        if out.weak[a]:
            second[a, :] = 0.0
            second[:, a] = 0.0
            second[a, a] = reading.weak_sigma * reading.weak_sigma
            out.ratios[a] = 1.0
    for a in range(3):
        for b in range(3):
            second[a, b] *= sqrt(out.ratios[a] * out.ratios[b])
    _turned(out.axes, second, out.covariance)
    lengths = np.empty(len(scored.points))
    _lengths(scored.points, lengths)
    _held(found.levers[_LAGS:], found.own_levers[_LAGS:], lengths, out.directions, out.held)
    for a in range(3):
        for b in range(a):
            out.covariance[b, a] = out.covariance[a, b]


@compiled
def _telling(scored: Scored, pose: F64) -> Scored:
    """The same with the points alone that tell where the scan lies, see `_telling_kernels`, unless they are few.

    A point without a normal fits either face of a wall's end, so that it may hold a match where it slid to: it helps to
    find the pose, but tells nothing about how well it is known. Nor does a point without a surfel: were it scored, all
    poses would be better that take it back to where walls were seen.
    """
    n, known, tells = len(scored.points), 0, np.empty(len(scored.points), np.bool_)
    c, s, x0, y0, per_metre = cos(pose[2]), sin(pose[2]), scored.origin[0], scored.origin[1], 1.0 / scored.cell
    for i in range(n):
        px, py, nx, ny = scored.points[i, 0], scored.points[i, 1], scored.normals[i, 0], scored.normals[i, 1]
        x, y, mx, my = pose[0] + c * px - s * py, pose[1] + s * px + c * py, c * nx - s * ny, s * nx + c * ny
        k = partner(x, y, mx, my, scored.surfels, scored.nearest, x0, y0, per_metre, scored.alike)
        tells[i] = k >= 0 and (nx != 0.0 or ny != 0.0)
        tells[i] = tells[i] and not beyond_end(x, y, k, scored.surfels, scored.nearest, x0, y0, per_metre)
        known += 1 if tells[i] else 0
    points, normals, spreads, count = np.empty((n, 2)), np.empty((n, 2)), np.empty(n), 0
    for i in range(n):
        if tells[i] or known < _FEWEST_TELLING:
            points[count, 0], points[count, 1] = scored.points[i, 0], scored.points[i, 1]
            normals[count, 0], normals[count, 1] = scored.normals[i, 0], scored.normals[i, 1]
            spreads[count] = scored.spreads[i]
            count += 1
    return Scored(
        points[:count],
        normals[:count],
        spreads[:count],
        scored.surfels,
        scored.nearest,
        scored.origin,
        scored.cell,
        scored.scale,
        scored.facing,
        scored.alike,
    )


@compiled
def _lay_grid(hessian: F64, precision: float, reading: Reading, out: Weighed) -> None:
    """Axes and steps of the grid: the principal axes of the Hessian, steps by their width."""
    values, curvature = np.empty(3), np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            curvature[a, b] = precision * hessian[a, b]
    _principal_axes(curvature, values, out.axes)
    for a in range(3):
        width = reading.spacing / sqrt(max(values[a], 1e-9))
        out.steps[a] = min(reading.max_step, max(reading.min_step, width))


@compiled
def _turned(basis: F64, matrix: F64, out: F64) -> None:
    """Basis · matrix · basisᵀ, all (3, 3)."""
    for a in range(3):
        for b in range(3):
            total = 0.0
            for p in range(3):
                for q in range(3):
                    total += basis[a, p] * matrix[p, q] * basis[b, q]
            out[a, b] = total
