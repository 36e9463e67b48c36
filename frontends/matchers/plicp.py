"""PLICP: ICP with a point-to-line metric (Censi 2008), its covariance from the noise of the ranges (Censi 2007)."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _bearing_kernels as kernels
from frontends.matchers.acceptance import AcceptanceConfig, Alignment
from frontends.matchers.bearing_scan import BearingScan
from frontends.matchers.errors import require
from frontends.matchers.single_scan import ReferenceScan, SingleScanMatcher


@dataclass(frozen=True, kw_only=True)
class PlicpConfig:
    """Settings of PLICP."""

    max_distance: float = 5.0
    """Farthest nearest point [m]."""
    trim: float = 0.95
    """Quantile of the errors kept in each iteration …"""
    adaptive_order: float = 0.7
    """… and, once the iterations have settled, those below `adaptive_factor` times this quantile of them."""
    adaptive_factor: float = 2.0
    """See `adaptive_order`."""
    damping: float = 1e-3
    """Pull towards the last pose where the lines leave it free, in correspondences per correspondence."""
    max_iterations: int = 80
    """Most iterations."""
    epsilon: float = 1e-5
    """The iterations end when none of them moves the scan farther than this [m, rad]."""
    range_sigma: float = 0.01
    """Standard deviation of one range [m], for the covariance."""
    weak_share: float = 0.01
    """A direction is unobservable when fewer than this share of the correspondences constrain it."""
    max_gap: float = 0.5
    """Neighbouring points nearer than this are taken as one surface when agreement is counted [m]."""
    acceptance: AcceptanceConfig = field(default_factory=AcceptanceConfig)
    """When a match is credible."""

    def __post_init__(self) -> None:
        require(self.max_distance > 0, f"plicp.max_distance must be positive, found {self.max_distance}")
        for name in ("trim", "adaptive_order"):
            value = getattr(self, name)
            require(0 < value <= 1, f"plicp.{name} must lie in (0, 1], found {value}")
        require(self.damping > 0, f"plicp.damping must be positive, found {self.damping}")
        require(self.max_iterations >= 1, f"plicp.max_iterations must be at least 1, found {self.max_iterations}")


class PlicpMatcher(SingleScanMatcher):
    """Minimises the distances of the points to the lines through their two nearest reference points."""

    def __init__(self, config: PlicpConfig | None = None) -> None:
        self.config = config or PlicpConfig()
        super().__init__(self.config.acceptance, self.config.max_gap)

    def _align(self, reference: ReferenceScan, points: BearingScan, T_frame_guess: NDArray[np.float64]) -> Alignment:
        config = self.config
        pose, hessian, scatter, (pairs, square, iterations) = kernels.plicp(
            reference.points.xy,
            reference.points.bearings,
            points.xy,
            T_frame_guess,
            config.max_distance,
            config.trim,
            config.adaptive_order,
            config.adaptive_factor,
            config.range_sigma,
            config.damping,
            config.max_iterations,
            config.epsilon,
        )
        return Alignment(
            T_frame_laser=pose,
            hessian=hessian,
            scatter=scatter,
            pairs=int(pairs),
            residual=math.sqrt(square),
            iterations=int(iterations),
            weak_share=config.weak_share,
        )
