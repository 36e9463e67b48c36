"""Compiled loop that follows scan after scan against one local map, for as long as every match is plain."""

from math import cos, hypot, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph._assign_kernels import assign
from graph._odometry_kernels import carry
from graph.compiled import ONE, compiled
from iceg.ice._noise_kernels import RangeNoise
from iceg.ice._point_kernels import _count_returns, scan_points
from iceg.ice._refinement_kernels import refine

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]


class Laser(NamedTuple):
    """How end points and normals are made of ranges, see `_point_kernels.scan_points`."""

    directions: F64
    origin: F64
    reach: float
    jump: float
    noise: RangeNoise


class Returns(NamedTuple):
    """Room for the points of one scan, see `_point_kernels.scan_points`."""

    points: F64
    normals: F64
    beams: I32
    spreads: F64


class Way(NamedTuple):
    """The way from a key scan: (3,) its pose, and odometry since.

    Attributes:
        T_ref_key: (3,) pose of the key scan.
        T_key_robot: (3,) odometry from there …
        covariance: … (3, 3) its covariance …
        path: … (2,) its length [m] and turns [rad].
    """

    T_ref_key: F64
    T_key_robot: F64
    covariance: F64
    path: F64


class Field(NamedTuple):
    """The local map, see `_refinement_kernels.refine`."""

    surfels: F64
    nearest: I32
    origin: F64
    cell: float


class Polish(NamedTuple):
    """How a scan is matched.

    Attributes:
        scale: see `_refinement_kernels.refine` [m]; as …
        iterations: …
        prior_weight: …
        facing: …
        alike: …
        fewest: points that it takes.
        credible: share of the points that must agree with the map.
        window: how far [m] …
        turn: … and by what angle a match may lie off its guess [rad].
    """

    scale: float
    iterations: int
    prior_weight: float
    facing: float
    alike: float
    fewest: int
    credible: float
    window: float
    turn: float


class Limits(NamedTuple):
    """Where a match is no longer plain, and where a scan becomes a key scan.

    Attributes:
        blind_range: beams that end within this see nothing [m].
        blind_share: a laser is covered if more than this share of its returns do.
        moved: a match farther than this from its guess [m] …
        turned: … or turned by more than this needs a closer look [rad].
        apart: a match farther than this from where odometry since the key scan puts it [m] …
        twisted: … or turned by more than this [rad] …
        contradicted: … and so far in squared Mahalanobis distance …
        variances: … contradicts it; (3,) of the match [m², m², rad²].
        key_distance: a scan farther than this from the last key scan [m] …
        key_turn: … or turned by more than this is a key scan [rad].
    """

    blind_range: float
    blind_share: float
    moved: float
    turned: float
    apart: float
    twisted: float
    contradicted: float
    variances: tuple[float, float, float]
    key_distance: float
    key_turn: float


@compiled
def follow(
    ranges: F32,
    steps: F64,
    variances: F64,
    laser: Laser,
    field: Field,
    polish: Polish,
    limits: Limits,
    way: Way,
    poses: F64,
    returns: Returns,
) -> tuple[int, int]:
    """Match scans one after the other, each from where odometry puts it after the one before.

    Args:
        ranges: (n, n_beams) [m], NaN without return.
        steps: (n, 3) odometry from the scan before to each.
        variances: (5,) of odometry, see `graph._odometry_kernels.carry`.
        laser: that took the scans.
        field: the local map.
        polish: how they are matched.
        limits: where it ends.
        way: since the last key scan; carried on in place to the last scan followed.
        poses: (n + 1, 3) row 0 is the scan before; the others are filled.
        returns: points of the last scan looked at.

    Returns:
        How many scans were followed, and the number of points of the last one if it is a key scan, 0 otherwise.
    """
    ahead, grown = np.empty(3), np.empty((3, 3))
    guess, expected = np.empty(3), np.empty(3)
    for k in range(len(steps)):
        assign(ahead, way.T_key_robot)
        assign(grown, way.covariance)
        distance, turn = carry(ahead, grown, steps[k : k + 1], variances)
        _compose(poses[k], steps[k], guess)
        n = _match(ranges[k], guess, laser, field, polish, limits, poses[k + 1], returns)
        if n == 0:
            return k, 0
        _compose(way.T_ref_key, ahead, expected)
        if _contradicts(poses[k + 1], expected, grown, limits):
            return k, 0
        assign(way.T_key_robot, ahead)
        assign(way.covariance, grown)
        way.path[0] += distance
        way.path[1] += turn
        distance, turn = _apart(way.T_ref_key, poses[k + 1])
        if distance > limits.key_distance or turn > limits.key_turn:
            return k + 1, n
    return len(steps), 0


@compiled
def _match(
    ranges: F32, guess: F64, laser: Laser, field: Field, polish: Polish, limits: Limits, pose: F64, returns: Returns
) -> int:
    """The pose of a scan, and how many points it has; 0 if it sees nothing or matches badly, or far from its guess."""
    if _is_blind(ranges, limits):
        return 0
    points, normals = returns.points, returns.normals
    n = scan_points(
        ranges,
        laser.directions,
        laser.origin,
        laser.reach,
        laser.jump,
        laser.noise,
        points,
        normals,
        returns.beams,
        returns.spreads,
    )
    if n < polish.fewest:
        return 0
    inliers, _, _, _ = refine(
        points[:n],
        normals[:n],
        returns.spreads[:n],
        ONE,
        guess,
        field.surfels,
        field.nearest,
        field.origin,
        field.cell,
        4 * polish.scale,
        polish.scale,
        polish.iterations,
        polish.prior_weight,
        polish.facing,
        polish.alike,
        pose,
        np.empty((3, 3)),
    )
    if inliers < polish.credible * n:
        return 0
    moved, turned = _apart(guess, pose)
    if moved >= min(polish.window, limits.moved) or turned >= min(polish.turn, limits.turned):
        return 0
    return int(n)


@compiled
def _is_blind(ranges: F32, limits: Limits) -> bool:
    """Whether nearly all beams that return end at once."""
    returns, close = _count_returns(ranges, limits.blind_range)
    return close > limits.blind_share * returns


@compiled
def _compose(T_a_b: F64, T_b_c: F64, T_a_c: F64) -> None:
    """`graph.se2.compose` of single poses, bit for bit."""
    c, s = cos(T_a_b[2]), sin(T_a_b[2])
    T_a_c[0] = T_a_b[0] + c * T_b_c[0] - s * T_b_c[1]
    T_a_c[1] = T_a_b[1] + s * T_b_c[0] + c * T_b_c[1]
    T_a_c[2] = _wrap(T_a_b[2] + T_b_c[2])


@compiled
def _wrap(angle: float) -> float:
    """An angle [rad] in (-3π, 3π) brought into (-π, π]."""
    if angle > pi:
        return angle - 2.0 * pi
    return angle + 2.0 * pi if angle <= -pi else angle


@compiled
def _apart(T_a_b: F64, T_a_c: F64) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    return hypot(T_a_c[0] - T_a_b[0], T_a_c[1] - T_a_b[1]), abs(_wrap(T_a_c[2] - T_a_b[2]))


@compiled
def _contradicts(T_ref_cur: F64, T_ref_expected: F64, covariance: F64, limits: Limits) -> bool:
    """Whether a match lies farther from where odometry puts it than their (3, 3) covariances explain."""
    distance, turn = _apart(T_ref_cur, T_ref_expected)
    if distance < limits.apart and turn < limits.twisted:
        return False
    dx, dy = T_ref_expected[0] - T_ref_cur[0], T_ref_expected[1] - T_ref_cur[1]
    c, s = cos(T_ref_cur[2]), sin(T_ref_cur[2])
    x, y, h = c * dx + s * dy, c * dy - s * dx, _wrap(T_ref_expected[2] - T_ref_cur[2])
    xx, yy = covariance[0, 0] + limits.variances[0], covariance[1, 1] + limits.variances[1]
    hh = covariance[2, 2] + limits.variances[2]
    xy, xh, yh = covariance[0, 1], covariance[0, 2], covariance[1, 2]
    # The inverse by cofactors.
    a, b, e = yy * hh - yh * yh, xh * yh - xy * hh, xy * yh - xh * yy
    d, f, g = xx * hh - xh * xh, xy * xh - xx * yh, xx * yy - xy * xy
    squares = a * x * x + d * y * y + g * h * h + 2.0 * (b * x * y + e * x * h + f * y * h)
    return bool(squares >= limits.contradicted * (xx * a + xy * b + xh * e))
