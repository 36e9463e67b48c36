"""What a covariance must be before it meets GTSAM, which checks nothing (zeros and negative variances pass)."""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from graph import dense
from graph.errors import GraphError

MAX_CONDITION = 1e8
"""Largest ratio of a covariance's eigenvalues (metres and radians as they are). A pose 10 m uncertain along a corridor
and 1 mrad in heading lies at 1e8; well beyond it, Cholesky factors of a graph lose the small directions to rounding."""

UNOBSERVED_SIGMA = 10.0
"""Standard deviation [m or rad] of a step along what its match does not observe: as good as nothing. The match itself
says 1 m there, with which gates compute; where odometry or velocity know little more, a graph would take it for
knowledge."""

_ASYMMETRY_TOLERANCE = 1e-6
_CAP_TOLERANCE = 1e-6


def conditioned(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """A covariance made fit for the graph: exactly symmetric, positive definite, condition number capped.

    Above `MAX_CONDITION` the smallest variances are raised, never the largest lowered: the graph may know less than the
    measurement claims, not more.

    Args:
        covariance: (3, 3), order x, y, θ; asymmetric by rounding at most.

    Returns:
        (3, 3), read-only.

    Raises:
        GraphError: not 3x3 finite numbers, asymmetric, or not positive definite.
    """
    if covariance.shape != (3, 3):
        raise GraphError(f"a covariance is 3x3, found shape {covariance.shape}")
    (xx, xy, xt), (yx, yy, yt), (tx, ty, tt) = covariance.tolist()
    trace = xx + yy + tt
    _check_symmetric(covariance, max(abs(xy - yx), abs(xt - tx), abs(yt - ty)), trace)
    a, b, c = 0.5 * (xy + yx), 0.5 * (xt + tx), 0.5 * (yt + ty)
    minor = xx * yy - a * a
    determinant = tt * minor - xx * c * c - yy * b * b + 2.0 * a * b * c
    # λmin = det / (λmid λmax) ≥ 4 det / trace², so trace³ / (4 det) bounds the condition number from above.
    if xx > 0.0 and minor > 0.0 and determinant > 0.0 and trace**3 <= 4.0 * MAX_CONDITION * determinant:
        fit = np.array(((xx, a, b), (a, yy, c), (b, c, tt)))
    else:
        fit = _capped(np.array(((xx, a, b), (a, yy, c), (b, c, tt))))
    fit.flags.writeable = False
    return fit


def information_of(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse of covariances, or of informations, exactly symmetric.

    Args:
        covariance: (..., 3, 3), symmetric and positive definite.

    Returns:
        (..., 3, 3).
    """
    inverse = dense.inv(covariance)
    return np.asarray(0.5 * (inverse + np.swapaxes(inverse, -1, -2)), dtype=np.float64)


def squared_norm(error: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    """Squared Mahalanobis norm of one (3,) error under a positive definite (3, 3) covariance.

    On plain floats: ten times quicker than a linear solver on three numbers.
    """
    a, b, c = error.tolist()
    (xx, _, _), (yx, yy, _), (tx, ty, tt) = covariance.tolist()
    # Forward substitution through the factors of L D Lᵀ.
    l10, l20 = yx / xx, tx / xx
    d1 = yy - l10 * yx
    l21 = (ty - l20 * yx) / d1
    d2 = tt - l20 * tx - l21 * l21 * d1
    v = b - l10 * a
    w = c - l20 * a - l21 * v
    return float(a * a / xx + v * v / d1 + w * w / d2)


def summed_ratios(covariance: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Sum of the ratios of two covariances' variances along the axes they share: the trace of other⁻¹ · covariance.

    Args:
        covariance: (3, 3), symmetric.
        other: (3, 3), positive definite.

    Returns:
        The sum of the eigenvalues of one relative to the other.
    """
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = other.tolist()
    a, b, c = yy * tt - yt * yt, xt * yt - xy * tt, xy * yt - xt * yy
    d, e, f = xx * tt - xt * xt, xy * xt - xx * yt, xx * yy - xy * xy
    (vxx, vxy, vxt), (_, vyy, vyt), (_, _, vtt) = covariance.tolist()
    adjugate = a * vxx + d * vyy + f * vtt + 2.0 * (b * vxy + c * vxt + e * vyt)
    return float(adjugate / (xx * a + xy * b + xt * c))


def largest_squared_norm(probability: float) -> float:
    """What the squared, whitened norm of a true (3,) error stays below with this probability: the χ² quantile."""
    return chi2_gate(1.0 - probability)


@lru_cache(maxsize=16)
def chi2_gate(false_alarm: float, freedom: int = 3) -> float:
    """What χ² of so many degrees of freedom exceeds with this probability: the gate that refuses so many true errors.

    Bisection on the closed form of the distribution; importing a library for it takes longer than solving the graph.

    Args:
        false_alarm: in (0, 1).
        freedom: degrees of freedom, at least one.
    """
    lower, upper = 0.0, 1500.0
    while lower < (middle := 0.5 * (lower + upper)) < upper:
        lower, upper = (middle, upper) if chi2_tail(middle, freedom) > false_alarm else (lower, middle)
    return middle


def chi2_tail(x: float, freedom: int) -> float:
    """Probability that χ² of so many degrees of freedom, at least one, exceeds x ≥ 0."""
    half = 0.5 * x
    tail, degrees = (math.exp(-half), 2) if freedom % 2 == 0 else (math.erfc(math.sqrt(half)), 1)
    while degrees < freedom:
        tail += half ** (0.5 * degrees) * math.exp(-half) / math.gamma(0.5 * degrees + 1.0)
        degrees += 2
    return tail


def _check_symmetric(covariance: NDArray[np.float64], asymmetry: float, trace: float) -> None:
    if not math.isfinite(trace) or not math.isfinite(asymmetry):
        raise GraphError(f"a covariance needs finite numbers, found {covariance.tolist()}")
    if asymmetry > _ASYMMETRY_TOLERANCE * abs(trace):
        raise GraphError(f"a covariance is symmetric, found {covariance.tolist()}")


def _capped(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    variances, axes = dense.eigh(covariance)
    if variances[0] <= 0.0:
        raise GraphError(
            f"a covariance is positive definite, found variances {variances.tolist()} along its axes"
            f" in {covariance.tolist()}"
        )
    # Rounding hides 1e-8 of the smallest: without the tolerance, what was capped would be capped again, and move.
    if variances[2] <= MAX_CONDITION * (1.0 + _CAP_TOLERANCE) * variances[0]:
        return covariance
    capped = dense.congruence(axes, np.diag(np.maximum(variances, variances[2] / MAX_CONDITION)))
    return np.asarray(0.5 * (capped + capped.T))
