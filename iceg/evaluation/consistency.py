"""Whether covariances are honest: the normalised estimation error squared (NEES) and its chi-square bounds.

Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 5.4.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graph import dense
from graph.se2 import between, logmap
from iceg.evaluation.errors import EvaluationError

DEGREES_OF_FREEDOM = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """How the errors of n poses compare with their covariances; 3 on average is right.

    Attributes:
        n: number of poses.
        mean: mean NEES; above 3 the covariances are too small, below too large.
        median: median NEES; 2.37 is right.
        share_within_95: share of the poses inside their own 95 % region; 0.95 is right.
        mean_low: lower end of the 95 % interval of the mean, were the n errors independent.
        mean_high: upper end of it. Errors along one trajectory are not independent: its mean scatters more widely.
    """

    n: int
    mean: float
    median: float
    share_within_95: float
    mean_low: float
    mean_high: float


def nees(errors: NDArray[np.float64], covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normalised estimation error squared, ξᵀ Σ⁻¹ ξ.

    Args:
        errors: (..., 3) tangent vectors ξ, order x, y, θ.
        covariances: (..., 3, 3) of those errors.

    Returns:
        (...,) squared Mahalanobis distances.

    Raises:
        EvaluationError: a covariance is not symmetric positive definite.
    """
    try:
        lower = dense.cholesky(covariances)
    except np.linalg.LinAlgError as err:
        raise EvaluationError("found a covariance that is not positive definite") from err
    with np.errstate(over="ignore", invalid="ignore"):
        squared = np.asarray((dense.solve_vector(lower, errors) ** 2).sum(axis=-1))
    if not np.isfinite(squared).all():
        raise EvaluationError("found a covariance that is all but singular, by which no error can be judged")
    return squared


def relative_pose_errors(T_estimated: NDArray[np.float64], T_true: NDArray[np.float64]) -> NDArray[np.float64]:
    """Errors of relative poses in the tangent space at the estimate: right perturbation, GTSAM's convention.

    Args:
        T_estimated: (..., 3).
        T_true: (..., 3).

    Returns:
        (..., 3) ξ with `T_true = T_estimated * exp(ξ)`.
    """
    return logmap(between(T_estimated, T_true))


def pose_nees(
    T_map_robot: NDArray[np.float64], T_world_robot: NDArray[np.float64], covariances: NDArray[np.float64]
) -> NDArray[np.float64]:
    """NEES of poses relative to the first, which anchors the map and has no error of its own.

    Args:
        T_map_robot: (n, 3) estimated key poses, the first one being the anchor.
        T_world_robot: (n, 3) their true poses, in any frame.
        covariances: (n, 3, 3) marginals in the tangent space at each estimate.

    Returns:
        (n − 1,) of all but the first.
    """
    T_first_estimated = between(T_map_robot[:1], T_map_robot[1:])
    T_first_true = between(T_world_robot[:1], T_world_robot[1:])
    return nees(relative_pose_errors(T_first_estimated, T_first_true), covariances[1:])


def consistency(values: NDArray[np.float64]) -> Consistency:
    """Summarise (n,) NEES values of three degrees of freedom each.

    Raises:
        EvaluationError: no value.
    """
    n = len(values)
    if n == 0:
        raise EvaluationError("found no pose to judge, a NEES needs at least one besides the first")
    low, high = chi_square_quantiles(np.array([0.025, 0.975]), DEGREES_OF_FREEDOM * n) / n
    return Consistency(
        n=n,
        mean=float(values.mean()),
        median=float(np.median(values)),
        share_within_95=float((values <= chi_square_quantiles(np.array(0.95), DEGREES_OF_FREEDOM)).mean()),
        mean_low=float(low),
        mean_high=float(high),
    )


def chi_square_quantiles(probabilities: NDArray[np.float64], degrees_of_freedom: int) -> NDArray[np.float64]:
    """Quantiles of the chi-square distribution, in the shape (...) of the probabilities."""
    from scipy.special import gammaincinv

    return np.asarray(2.0 * gammaincinv(degrees_of_freedom / 2.0, probabilities))
