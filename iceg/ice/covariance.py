"""Covariance of a match from the correlation scores around its optimum (Olson 2009)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graph.measurement import Held
from iceg.ice import _score_kernels as kernels
from iceg.ice._score_kernels import Reading, Weighed
from iceg.ice.config import CovarianceConfig, RefinementConfig
from iceg.ice.local_map import LocalMap
from iceg.ice.points import ScanPoints
from iceg.ice.refinement import Refined
from iceg.ice.scored import Scored

_SIDE = 5
"""Poses of the grid along each axis."""
_SPACING = 1.25
"""Grid spacing in standard deviations of the flattened Hessian's Gaussian."""
_MIN_STEP = 5e-4
"""Smallest spacing of the score grid [m, rad]."""
_TEMPERATURE = 6.0
"""The scores are taken this much flatter and their second moment is divided by it: the costs are rough on the scale
of the peak itself (correspondences change), and a single low one must not pass for certainty."""
_GRAZING = 0.5
"""Points of a wall far down a corridor lie truer on it than the laser measures: across it hardly any of the range noise
is left. So the points that hold one direction may have residuals this much smaller than the least of all."""
_EDGE_MASS = 0.25
"""Share of the weight on the edge of the widest grid from which on a direction counts as unobservable."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreCovariance:
    """Second moment of the scores.

    Attributes:
        covariance: (3, 3) tangent space of the robot at the optimum, order x, y, θ.
        weak_directions: (k, 3) unit vectors along which the scores do not fall off inside the window.
        held: by how much wall the position is held.
        weights: (5, 5, 5) normalised scores on the grid, axis i along `axes[:, i]`.
        axes: (3, 3) columns: principal directions of the grid in the tangent space.
        steps: (3,) spacing along each axis [m or rad].
    """

    covariance: NDArray[np.float64]
    weak_directions: NDArray[np.float64]
    held: Held
    weights: NDArray[np.float64]
    axes: NDArray[np.float64]
    steps: NDArray[np.float64]


def score_covariance(
    scan_points: ScanPoints,
    local_map: LocalMap,
    refined: Refined,
    refinement: RefinementConfig,
    config: CovarianceConfig,
) -> ScoreCovariance:
    """Weigh a grid of poses around the optimum by its scores; Σ = K/s − uuᵀ/s².

    The grid lies along the principal directions of the Hessian, two and a half standard deviations of the flattened
    scores to each side, so that it resolves the peak whatever its shape. Where the weights do not vanish at the edge
    of the largest window the direction is unobservable: it is reported and given a variance that leaves it to
    odometry.

    A score counts as much as the residuals deserve: their size, and how far neighbouring points agree in them. White
    residuals are noise, and many points average it away; correlated ones tell of a reference that is not quite right,
    and many points repeat the same error.

    Args:
        scan_points: points of the new scan.
        local_map: the reference.
        refined: the optimum.
        refinement: width of the Cauchy score, and which points tell something.
        config: noise level, share of independent points, window.

    Returns:
        The covariance with its weak directions.
    """
    scored = Scored.of(scan_points, local_map, refinement)
    reading = Reading(
        n_picks=config.points,
        sigma=max(config.min_sigma, refined.residual),
        least_variance=(_GRAZING * config.min_sigma) ** 2,
        limit=2 * refinement.scale,
        independence=config.independence,
        temperature=_TEMPERATURE,
        spacing=_SPACING,
        min_step=_MIN_STEP,
        max_step=config.max_step,
        edge_mass=_EDGE_MASS,
        weak_sigma=config.weak_sigma,
    )
    found = Weighed.empty(_SIDE)
    kernels.score_covariance(scored, refined.T_ref_cur, reading, found)
    return ScoreCovariance(
        covariance=found.covariance,
        weak_directions=found.axes[:, found.weak].T,
        held=Held(directions=found.directions, lengths=found.held),
        weights=found.weights,
        axes=found.axes,
        steps=found.steps,
    )
