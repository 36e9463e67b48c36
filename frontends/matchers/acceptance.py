"""When the outcome of a point matcher is credible, and the measurement made of it."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frontends.matchers.errors import require
from frontends.matchers.restarts import RestartConfig
from graph import dense
from graph.measurement import NoMatch
from graph.se2 import adjoint, between, inverse


@dataclass(frozen=True, kw_only=True)
class AcceptanceConfig:
    """What a match must show before it is believed; the same for every point matcher."""

    min_pairs: int = 20
    """Fewest correspondences of the last iteration …"""
    min_share: float = 0.15
    """… and the least share of the scan's points that has one."""
    max_residual: float = 0.6
    """Largest root mean square residual of the correspondences, in the matcher's own metric [m]."""
    inlier_distance: float = 0.1
    """A point within this distance of the reference's surface agrees with it [m]."""
    known_distance: float = 0.5
    """A point within this distance of it falls on known reference [m]."""
    min_inliers: float = 0.4
    """Least share of the scan's points that agree."""
    max_translation: float = 1.5
    """A match may leave the guess by this much [m] …"""
    max_rotation: float = math.radians(75.0)
    """… and this [rad] …"""
    max_sigmas: float = 4.0
    """… or by this many standard deviations of the guess where that is more."""
    covariance_scale: float = 1.0
    """Factor on the matcher's own covariance; 1 is the paper's."""
    min_sigma: float = 5e-4
    """Smallest standard deviation reported along any direction [m, rad]."""
    weak_sigma: float = 1.0
    """Standard deviation given to a direction the matcher says it cannot observe [m, rad]."""
    restarts: RestartConfig = field(default_factory=RestartConfig)
    """Other starts where the first one ends badly."""

    def __post_init__(self) -> None:
        require(self.min_pairs >= 3, f"acceptance.min_pairs must be at least 3, found {self.min_pairs}")
        for name in ("min_share", "min_inliers"):
            value = getattr(self, name)
            require(0 <= value <= 1, f"acceptance.{name} must lie in [0, 1], found {value}")
        for name in ("max_residual", "covariance_scale", "min_sigma", "inlier_distance"):
            value = getattr(self, name)
            require(value > 0, f"acceptance.{name} must be positive, found {value}")
        require(self.inlier_distance <= self.known_distance, "acceptance: inlier_distance exceeds known_distance")
        require(self.min_sigma < self.weak_sigma, "acceptance: min_sigma must be less than weak_sigma")


@dataclass(frozen=True, slots=True, kw_only=True)
class Alignment:
    """What the iterations of a point matcher end with, laser against reference frame.

    Attributes:
        T_frame_laser: (3,) pose of the scan's laser in the frame of the reference.
        hessian: (3, 3) H of its least squares, for a small motion in the axes and about the origin of the frame.
        scatter: (3, 3) M of its gradient: the covariance of that motion is H⁻¹ M H⁻¹.
        pairs: correspondences of the last iteration.
        residual: their root mean square residual, in the matcher's metric [m].
        iterations: how many there were.
        weak_share: a direction of H is unobservable where its eigenvalue is below this share of `pairs`.
    """

    T_frame_laser: NDArray[np.float64]
    hessian: NDArray[np.float64]
    scatter: NDArray[np.float64]
    pairs: int
    residual: float
    iterations: int
    weak_share: float = 0.0


def objection(
    found: Alignment,
    n_points: int,
    T_frame_guess: NDArray[np.float64],
    covariance_guess: NDArray[np.float64],
    config: AcceptanceConfig,
) -> NoMatch | None:
    """Why an alignment is not credible, None if it is.

    Args:
        found: the alignment.
        n_points: points of the scan.
        T_frame_guess: (3,) where it started.
        covariance_guess: (3, 3) of the start, tangent space there.
        config: the limits.
    """
    if found.pairs < max(config.min_pairs, config.min_share * n_points):
        return NoMatch(reason=f"only {found.pairs} of {n_points} points have a correspondence")
    if found.residual > config.max_residual:
        return NoMatch(reason=f"correspondences are {found.residual:.2f} m apart")
    if not np.isfinite(found.T_frame_laser).all():
        return NoMatch(reason="the iterations diverged")
    x, y, turn = between(T_frame_guess, found.T_frame_laser).tolist()
    sigma = math.sqrt(max(covariance_guess[0, 0], covariance_guess[1, 1]))
    if math.hypot(x, y) > max(config.max_translation, config.max_sigmas * sigma):
        return NoMatch(reason=f"the match lies {math.hypot(x, y):.2f} m from the guess")
    if abs(turn) > max(config.max_rotation, config.max_sigmas * math.sqrt(covariance_guess[2, 2])):
        return NoMatch(reason=f"the match is turned {math.degrees(abs(turn)):.0f}° from the guess")
    return None


def tangent_covariance(
    found: Alignment, T_robot_laser: NDArray[np.float64], config: AcceptanceConfig
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """H⁻¹ M H⁻¹ as the covariance of the robot's pose, in the tangent space at it.

    Args:
        found: the alignment.
        T_robot_laser: (3,) mount of the laser.
        config: bounds on the standard deviations.

    Returns:
        (3, 3) covariance, order x, y, θ of the robot, and (k, 3) directions of it that are unobservable.
    """
    # H and M refer to exp(ξ)·T; exp(ξ)·T_frame_laser·T_laser_robot = T_frame_robot·exp(Ad ξ).
    to_frame = dense.matmul(adjoint(found.T_frame_laser), adjoint(inverse(T_robot_laser)))
    hessian = dense.congruence(to_frame.T, found.hessian)
    scatter = dense.congruence(to_frame.T, found.scatter)
    eigenvalues, axes = dense.eigh(hessian)
    weak = eigenvalues <= max(found.weak_share * found.pairs, 1e-12 * eigenvalues[-1])
    gain = dense.matmul(axes / np.where(weak, np.inf, eigenvalues), axes.T)
    observed = config.covariance_scale * dense.congruence(gain, scatter)
    unobserved = config.weak_sigma**2 * dense.matmul(axes[:, weak], axes[:, weak].T)
    return _bounded(observed + unobserved, config), axes[:, weak].T.copy()


def _bounded(covariance: NDArray[np.float64], config: AcceptanceConfig) -> NDArray[np.float64]:
    """Exactly symmetric, standard deviations between the smallest and that of a weak direction."""
    variances, axes = dense.eigh(covariance)
    bounded = dense.congruence(axes, np.diag(np.clip(variances, config.min_sigma**2, config.weak_sigma**2)))
    return np.asarray(0.5 * (bounded + bounded.T), dtype=np.float64)
