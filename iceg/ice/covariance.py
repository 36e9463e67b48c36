"""Covariance of a match from the correlation scores around its optimum (Olson 2009)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iceg.ice import _field_kernels as kernels
from iceg.ice.config import CovarianceConfig
from iceg.ice.local_map import LocalMap
from iceg.ice.points import ScanPoints, spread
from iceg.ice.refinement import FACING, Refined

_HALF = 2
_SPACING = 1.25
"""Grid spacing in standard deviations of the Hessian's Gaussian."""
_MIN_STEP = 5e-4
_EDGE_MASS = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreCovariance:
    """Second moment of the scores.

    Attributes:
        covariance: (3, 3) tangent space of the robot at the optimum, order x, y, θ.
        weak_directions: (k, 3) unit vectors along which the scores do not fall off inside the window.
        weights: (5, 5, 5) normalised scores on the grid, axis i along `axes[:, i]`.
        axes: (3, 3) columns: principal directions of the grid in the tangent space.
        steps: (3,) spacing along each axis [m or rad].
    """

    covariance: NDArray[np.float64]
    weak_directions: NDArray[np.float64]
    weights: NDArray[np.float64]
    axes: NDArray[np.float64]
    steps: NDArray[np.float64]


def score_covariance(
    scan_points: ScanPoints, local_map: LocalMap, refined: Refined, scale: float, config: CovarianceConfig
) -> ScoreCovariance:
    """Weigh a grid of poses around the optimum by its scores; Σ = K/s − uuᵀ/s².

    The grid lies along the principal directions of the Hessian, two and a half standard deviations to each side, so that it
    resolves the peak whatever its shape. Where the weights do not vanish at the edge of the largest window the
    direction is unobservable: it is reported and given a variance that leaves it to odometry.

    Args:
        scan_points: points of the new scan.
        local_map: the reference.
        refined: the optimum.
        scale: width of the Cauchy score [m].
        config: noise level, share of independent points, window.

    Returns:
        The covariance with its weak directions.
    """
    heading = refined.T_ref_cur[2]
    sigma = max(config.min_sigma, refined.residual)
    information = _to_tangent(refined.hessian, heading) * (config.independence / sigma**2)
    eigenvalues, axes = np.linalg.eigh(information)
    steps = np.clip(_SPACING / np.sqrt(np.maximum(eigenvalues, 1e-9)), _MIN_STEP, config.max_step)
    picks = spread(len(scan_points), config.points)
    costs = np.empty((2 * _HALF + 1,) * 3)
    field = local_map.fine
    best = kernels.score_grid(
        scan_points.points,
        scan_points.normals,
        picks,
        local_map.surfels,
        field.nearest,
        field.origin,
        field.cell,
        scale,
        FACING,
        refined.T_ref_cur,
        axes,
        steps,
        _HALF,
        costs,
    )
    per_cost = 0.5 * (scale / sigma) ** 2 * config.independence * len(scan_points) / max(1, len(picks))
    weights = np.exp(-per_cost * (costs - best))
    weights /= weights.sum()
    return _moments(weights, axes, steps, config)


def _moments(
    weights: NDArray[np.float64], axes: NDArray[np.float64], steps: NDArray[np.float64], config: CovarianceConfig
) -> ScoreCovariance:
    offsets = np.arange(-_HALF, _HALF + 1, dtype=np.float64)
    marginals = [weights.sum(axis=tuple(k for k in range(3) if k != i)) for i in range(3)]
    u = np.array([float(m @ offsets) for m in marginals]) * steps
    second = np.empty((3, 3))
    for i in range(3):
        second[i, i] = float(marginals[i] @ offsets**2) * steps[i] ** 2
        for j in range(i):
            joint = weights.sum(axis=3 - i - j)
            second[i, j] = second[j, i] = float(offsets @ joint @ offsets) * steps[i] * steps[j]
    spread_ = second - np.outer(u, u) + np.diag((0.1 * steps) ** 2)
    edge = np.array([m[0] + m[-1] for m in marginals])
    weak = (edge > _EDGE_MASS) & (steps >= 0.999 * config.max_step)
    spread_[weak, :] = 0.0
    spread_[:, weak] = 0.0
    spread_[weak, weak] = config.weak_sigma**2
    covariance = axes @ spread_ @ axes.T
    return ScoreCovariance(
        covariance=0.5 * (covariance + covariance.T),
        weak_directions=axes[:, weak].T.copy(),
        weights=weights,
        axes=axes,
        steps=steps,
    )


def _to_tangent(hessian: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    """Rotate a Hessian in reference axes into the axes of the robot."""
    c, s = np.cos(heading), np.sin(heading)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(rotation.T @ hessian @ rotation, dtype=np.float64)
