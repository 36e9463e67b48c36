"""The iterations that WSM and QWSM share."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _weighted_kernels as kernels
from frontends.matchers.acceptance import AcceptanceConfig, Alignment
from frontends.matchers.errors import require
from frontends.matchers.point_matcher import PointMatcher
from frontends.matchers.weighted_points import PointNoiseConfig, WeightedPoints, weigh_scan
from frontends.scan import Scan


@dataclass(frozen=True, kw_only=True)
class IterationConfig:
    """The weighted least squares on nearest pairs."""

    max_distance: float = 2.0
    """Farthest correspondence [m]."""
    trim: float = 0.95
    """Share of the correspondences kept in each iteration, the nearest ones."""
    gate: float = 4.0
    """Once the iterations have settled, correspondences beyond this many standard deviations are left out."""
    max_iterations: int = 80
    """Most iterations."""
    coarse_epsilon: float = 0.01
    """The iterations have settled when one of them moves the scan by less than this [m, rad]."""
    epsilon: float = 1e-4
    """The iterations end when none of them moves the scan farther than this [m, rad]."""

    def __post_init__(self) -> None:
        for name in ("max_distance", "gate", "epsilon"):
            value = getattr(self, name)
            require(value > 0, f"iteration.{name} must be positive, found {value}")
        require(self.coarse_epsilon >= self.epsilon, "iteration: coarse_epsilon must be at least epsilon")
        require(0 < self.trim <= 1, f"iteration.trim must lie in (0, 1], found {self.trim}")
        require(self.max_iterations >= 1, f"iteration.max_iterations must be at least 1, found {self.max_iterations}")


class WeightedMatcher(PointMatcher[WeightedPoints, WeightedPoints]):
    """Translation (ΣP⁻¹)⁻¹ΣP⁻¹(p_i − R p_j), rotation about the weighted midpoint, in turn until nothing moves.

    Covariance: (ΣP⁻¹)⁻¹ of the translation and that of the rotation, independent at the midpoint.
    """

    def __init__(
        self, noise: PointNoiseConfig, iteration: IterationConfig, acceptance: AcceptanceConfig, *, mutual: bool
    ) -> None:
        """Weigh points by `noise`; `mutual` keeps only pairs that are each other's nearest."""
        super().__init__(acceptance)
        self._noise = noise
        self._iteration = iteration
        self._mutual = mutual

    def _extract(self, scan: Scan) -> WeightedPoints:
        return weigh_scan(scan, self._noise)

    def _align(
        self, reference: WeightedPoints, points: WeightedPoints, T_frame_guess: NDArray[np.float64]
    ) -> Alignment:
        config = self._iteration
        rules = kernels.Rules(
            self._mutual,
            config.max_distance,
            config.trim,
            config.gate,
            config.max_iterations,
            config.coarse_epsilon,
            config.epsilon,
        )
        start = np.asarray(T_frame_guess, dtype=np.float64)
        pose, information, (pairs, square, iterations) = kernels.weighted_match(
            reference.cloud(), points.cloud(), start, rules
        )
        return Alignment(
            T_frame_laser=pose,
            hessian=information,
            scatter=information,
            pairs=int(pairs),
            residual=math.sqrt(square),
            iterations=int(iterations),
        )

    def _agreeing(
        self, reference: WeightedPoints, points: WeightedPoints, T_frame_laser: NDArray[np.float64]
    ) -> tuple[int, int]:
        acceptance = self._acceptance
        inliers, known = kernels.weighted_agreement(
            reference.cloud(), points.tree.xy, T_frame_laser, acceptance.inlier_distance, acceptance.known_distance
        )
        return int(inliers), int(known)
