"""SE(2): planar poses as arrays.

A pose is an array (..., 3): x [m], y [m], heading [rad] in (−π, π]; batch axes lead and broadcast. `T_a_b` is the pose
of frame b in frame a, so `compose(T_a_b, T_b_c)` is `T_a_c`. A tangent vector ξ is (..., 3) in the order x, y, θ and
perturbs from the right, `T · exp(ξ)`: GTSAM's `Pose2` convention, for covariances and Jacobians alike.

Single poses take a path of plain floats, ten times quicker than NumPy on three numbers.
"""

import math
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graph.dense import congruence, matmul
from graph.elementary import cos_sin

_TWO_PI = 2.0 * math.pi
_SERIES_BELOW = 1e-4  # [rad] the first term that each series leaves out is then below 1e-17


@overload
def wrap_angle(angle: float) -> float: ...
@overload
def wrap_angle(angle: NDArray[np.float64]) -> NDArray[np.float64]: ...
def wrap_angle(angle: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
    """Bring angles into (−π, π]; angles already there keep every bit.

    Args:
        angle: one float or (...) [rad].

    Returns:
        The same shape, [rad] in (−π, π].
    """
    if isinstance(angle, float):
        return _wrap(angle)
    wrapped = np.fmod(np.asarray(angle, dtype=np.float64), _TWO_PI)
    wrapped = np.where(wrapped > math.pi, wrapped - _TWO_PI, wrapped)
    return np.where(wrapped <= -math.pi, wrapped + _TWO_PI, wrapped)


def compose(T_a_b: ArrayLike, T_b_c: ArrayLike) -> NDArray[np.float64]:
    """The pose of c in a.

    Args:
        T_a_b: (..., 3) pose of b in a.
        T_b_c: (..., 3) pose of c in b.

    Returns:
        (..., 3) T_a_c.
    """
    first, second = np.asarray(T_a_b, dtype=np.float64), np.asarray(T_b_c, dtype=np.float64)
    if first.ndim == 1 and second.ndim == 1:
        return _compose_one(first, second)
    return _paired(first, second, back=False)


def inverse(T_a_b: ArrayLike) -> NDArray[np.float64]:
    """The pose of a in b.

    Args:
        T_a_b: (..., 3).

    Returns:
        (..., 3) T_b_a.
    """
    pose = np.asarray(T_a_b, dtype=np.float64)
    if pose.ndim == 1:
        return _inverse_one(pose)
    x, y, heading = pose[..., 0], pose[..., 1], pose[..., 2]
    c, s = cos_sin(heading)
    return np.stack([-c * x - s * y, s * x - c * y, wrap_angle(-heading)], axis=-1)


def between(T_a_b: ArrayLike, T_a_c: ArrayLike) -> NDArray[np.float64]:
    """The pose of c in b, both given in a: `inverse(T_a_b) · T_a_c`.

    Args:
        T_a_b: (..., 3) pose of b in a.
        T_a_c: (..., 3) pose of c in a.

    Returns:
        (..., 3) T_b_c.
    """
    first, second = np.asarray(T_a_b, dtype=np.float64), np.asarray(T_a_c, dtype=np.float64)
    if first.ndim == 1 and second.ndim == 1:
        return _between_one(first, second)
    return _paired(first, second, back=True)


def transform_points(T_a_b: ArrayLike, p_b: ArrayLike) -> NDArray[np.float64]:
    """Points of frame b in frame a.

    Args:
        T_a_b: (..., 3) pose of b in a; its batch axes broadcast against those of the points, so one pose moves any
            number of points and `T_a_b[:, None]` moves (n, m, 2) points by n poses.
        p_b: (..., 2) points [m].

    Returns:
        (..., 2) points [m].
    """
    pose, points = np.asarray(T_a_b, dtype=np.float64), np.asarray(p_b, dtype=np.float64)
    if pose.ndim == 1:
        return _transform_points_one(pose, points)
    c, s = cos_sin(pose[..., 2])
    x, y = points[..., 0], points[..., 1]
    return np.stack([pose[..., 0] + c * x - s * y, pose[..., 1] + s * x + c * y], axis=-1)


def expmap(xi: ArrayLike) -> NDArray[np.float64]:
    """The pose reached by following the constant twist ξ for one unit of time.

    Args:
        xi: (..., 3) tangent vector x [m], y [m], θ [rad].

    Returns:
        (..., 3) exp(ξ).
    """
    tangent = np.asarray(xi, dtype=np.float64)
    if tangent.ndim == 1:
        return _expmap_one(tangent)
    u, v, theta = tangent[..., 0], tangent[..., 1], tangent[..., 2]
    small = np.abs(theta) < _SERIES_BELOW
    divisor = np.where(small, 1.0, theta)
    c, s = cos_sin(theta / 2.0)
    along = np.where(small, 1.0 - theta * theta / 6.0, 2.0 * s * c / divisor)
    across = np.where(small, theta / 2.0 * (1.0 - theta * theta / 12.0), 2.0 * s * s / divisor)
    return np.stack([along * u - across * v, across * u + along * v, wrap_angle(theta)], axis=-1)


def logmap(T_a_b: ArrayLike) -> NDArray[np.float64]:
    """The tangent vector whose exponential is the pose; the turn is the shorter one.

    Args:
        T_a_b: (..., 3).

    Returns:
        (..., 3) ξ with `expmap(ξ)` = T_a_b, θ in (−π, π].
    """
    pose = np.asarray(T_a_b, dtype=np.float64)
    if pose.ndim == 1:
        return _logmap_one(pose)
    x, y, theta = pose[..., 0], pose[..., 1], wrap_angle(pose[..., 2])
    half = theta / 2.0
    small = np.abs(theta) < _SERIES_BELOW
    c, s = cos_sin(np.where(small, 1.0, half))
    cotangent = np.where(small, 1.0 - theta * theta / 12.0, half * c / s)
    return np.stack([cotangent * x + half * y, cotangent * y - half * x, theta], axis=-1)


def adjoint(T_a_b: ArrayLike) -> NDArray[np.float64]:
    """The adjoint map: `T · exp(ξ) = exp(Ad ξ) · T`.

    Args:
        T_a_b: (..., 3).

    Returns:
        (..., 3, 3), order x, y, θ.
    """
    pose = np.asarray(T_a_b, dtype=np.float64)
    if pose.ndim == 1:
        return _adjoint_one(pose)
    c, s = cos_sin(pose[..., 2])
    matrix = np.zeros((*pose.shape[:-1], 3, 3))
    matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 0, 2] = c, -s, pose[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 1], matrix[..., 1, 2] = s, c, -pose[..., 0]
    matrix[..., 2, 2] = 1.0
    return matrix


def compose_jacobians(T_a_b: ArrayLike, T_b_c: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Derivatives of `compose` in the tangent spaces at its arguments and at its result.

    Args:
        T_a_b: (..., 3); does not enter (the group is its own symmetry) except for its batch shape.
        T_b_c: (..., 3).

    Returns:
        (..., 3, 3) by T_a_b and (..., 3, 3) by T_b_c.
    """
    by_first = adjoint(inverse(T_b_c))
    shape = np.broadcast_shapes(np.shape(T_a_b), np.shape(T_b_c))[:-1]
    return np.broadcast_to(by_first, (*shape, 3, 3)), np.broadcast_to(np.eye(3), (*shape, 3, 3))


def between_jacobians(T_a_b: ArrayLike, T_a_c: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Derivatives of `between` in the tangent spaces at its arguments and at its result.

    Args:
        T_a_b: (..., 3).
        T_a_c: (..., 3).

    Returns:
        (..., 3, 3) by T_a_b and (..., 3, 3) by T_a_c.
    """
    by_first = -adjoint(between(T_a_c, T_a_b))
    return by_first, np.broadcast_to(np.eye(3), by_first.shape)


def compose_covariance(
    covariance_a_b: NDArray[np.float64], T_b_c: ArrayLike, covariance_b_c: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Covariance of `compose(T_a_b, T_b_c)` for independent errors, to first order.

    Args:
        covariance_a_b: (..., 3, 3) in the tangent space at T_a_b.
        T_b_c: (..., 3).
        covariance_b_c: (..., 3, 3) in the tangent space at T_b_c.

    Returns:
        (..., 3, 3) in the tangent space at T_a_c.
    """
    carry = adjoint(inverse(T_b_c))
    return _symmetric(congruence(carry, covariance_a_b) + covariance_b_c)


def chain_covariance(T_steps: ArrayLike, covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance of the product of a whole chain of poses with independent errors, to first order.

    Args:
        T_steps: (..., n, 3) pose of each frame in the one before it.
        covariances: (..., n, 3, 3) in the tangent spaces at them.

    Returns:
        (..., 3, 3) in the tangent space at the chain's end; zeros for an empty chain.
    """
    steps = np.asarray(T_steps, dtype=np.float64)
    total = np.zeros((*steps.shape[:-2], 3, 3))
    for k in range(steps.shape[-2]):
        total = compose_covariance(total, steps[..., k, :], covariances[..., k, :, :])
    return total


def inverse_covariance(T_a_b: ArrayLike, covariance_a_b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance of `inverse(T_a_b)`, to first order.

    Args:
        T_a_b: (..., 3).
        covariance_a_b: (..., 3, 3) in the tangent space at T_a_b.

    Returns:
        (..., 3, 3) in the tangent space at T_b_a.
    """
    carry = adjoint(T_a_b)
    return _symmetric(congruence(carry, covariance_a_b))


def between_covariance(
    T_a_b: ArrayLike,
    covariance_a_b: NDArray[np.float64],
    T_a_c: ArrayLike,
    covariance_a_c: NDArray[np.float64],
    cross: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Covariance of `between(T_a_b, T_a_c)`, to first order.

    Args:
        T_a_b: (..., 3).
        covariance_a_b: (..., 3, 3) in the tangent space at T_a_b.
        T_a_c: (..., 3).
        covariance_a_c: (..., 3, 3) in the tangent space at T_a_c.
        cross: (..., 3, 3) E[ξ_b ξ_cᵀ], the block between the two poses; None takes them as independent, which two
            poses of one graph never are.

    Returns:
        (..., 3, 3) in the tangent space at T_b_c.
    """
    by_b, _ = between_jacobians(T_a_b, T_a_c)
    total = congruence(by_b, covariance_a_b) + covariance_a_c
    if cross is not None:
        mixed = matmul(by_b, cross)
        total = total + mixed + np.swapaxes(mixed, -1, -2)
    return _symmetric(total)


def _wrap(angle: float) -> float:
    """One angle [rad] in (−π, π]; bit for bit what `wrap_angle` says."""
    if -math.pi < angle <= math.pi:
        return angle
    wrapped = math.remainder(angle, _TWO_PI)
    return wrapped if wrapped > -math.pi else wrapped + _TWO_PI


def _paired(first: NDArray[np.float64], second: NDArray[np.float64], *, back: bool) -> NDArray[np.float64]:
    """Poses composed, or between each other, whose batch axes broadcast."""
    from graph import _se2_kernels as kernels

    shape = np.broadcast_shapes(first.shape, second.shape)
    if shape[-1] != 3 or first.shape[-1] != second.shape[-1]:
        raise ValueError(f"found poses of {first.shape[-1]} and {second.shape[-1]} numbers, expected 3")
    paired = np.empty(shape)
    kernels.pair_up(_rows(first, shape), _rows(second, shape), back, paired.reshape(-1, 3))
    return paired


def _rows(poses: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """(n, 3) poses broadcast to a shape, contiguous and as good as new; a single one is not repeated."""
    if poses.size != 3 and poses.shape != shape:
        poses = np.broadcast_to(poses, shape)
    flags = poses.flags
    fit = poses if flags.c_contiguous and flags.writeable else np.array(poses, order="C")
    return fit.reshape(-1, 3)


def _compose_one(T_a_b: NDArray[np.float64], T_b_c: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, heading = T_a_b.tolist()
    dx, dy, turn = T_b_c.tolist()
    c, s = math.cos(heading), math.sin(heading)
    return np.array((x + c * dx - s * dy, y + s * dx + c * dy, _wrap(heading + turn)))


def _inverse_one(T_a_b: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, heading = T_a_b.tolist()
    c, s = math.cos(heading), math.sin(heading)
    return np.array((-c * x - s * y, s * x - c * y, _wrap(-heading)))


def _between_one(T_a_b: NDArray[np.float64], T_a_c: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, heading = T_a_b.tolist()
    x_c, y_c, heading_c = T_a_c.tolist()
    dx, dy = x_c - x, y_c - y
    c, s = math.cos(heading), math.sin(heading)
    return np.array((c * dx + s * dy, c * dy - s * dx, _wrap(heading_c - heading)))


def _transform_points_one(T_a_b: NDArray[np.float64], p_b: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, heading = T_a_b.tolist()
    c, s = math.cos(heading), math.sin(heading)
    moved = np.empty(p_b.shape)
    moved[..., 0] = c * p_b[..., 0] - s * p_b[..., 1] + x
    moved[..., 1] = s * p_b[..., 0] + c * p_b[..., 1] + y
    return moved


def _expmap_one(xi: NDArray[np.float64]) -> NDArray[np.float64]:
    u, v, theta = xi.tolist()
    if abs(theta) < _SERIES_BELOW:
        along, across = 1.0 - theta * theta / 6.0, theta / 2.0 * (1.0 - theta * theta / 12.0)
    else:
        c, s = math.cos(theta / 2.0), math.sin(theta / 2.0)
        along, across = 2.0 * s * c / theta, 2.0 * s * s / theta
    return np.array((along * u - across * v, across * u + along * v, _wrap(theta)))


def _logmap_one(T_a_b: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, heading = T_a_b.tolist()
    theta = _wrap(heading)
    half = theta / 2.0
    cotangent = 1.0 - theta * theta / 12.0 if abs(theta) < _SERIES_BELOW else half * math.cos(half) / math.sin(half)
    return np.array((cotangent * x + half * y, cotangent * y - half * x, theta))


def _adjoint_one(T_a_b: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, heading = T_a_b.tolist()
    c, s = math.cos(heading), math.sin(heading)
    return np.array(((c, -s, y), (s, c, -x), (0.0, 0.0, 1.0)))


def _symmetric(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))
