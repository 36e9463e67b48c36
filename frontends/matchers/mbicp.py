"""MbICP: ICP in a metric that knows of rotation (Minguez, Montesano and Lamiraux 2006)."""

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
class MbicpConfig:
    """Settings of MbICP."""

    length: float = 3.0
    """L of the metric: a turn of 1 rad counts as much as a shift by this [m]."""
    window: float = math.radians(60.0)
    """Correspondences are sought this far to either side of a point's bearing [rad]."""
    max_distance: float = 2.0
    """Farthest correspondence, in the metric [m]."""
    trim: float = 0.95
    """Share of the correspondences kept in each iteration, the nearest ones …"""
    final_trim: float = 0.85
    """… and once the iterations have settled: far from the optimum too many would be lost."""
    max_iterations: int = 80
    """Most iterations."""
    epsilon: float = 1e-4
    """The iterations end when none of them moves the scan farther than this [m, rad]."""
    max_gap: float = 0.5
    """Neighbouring points nearer than this are joined by a straight piece of surface [m]."""
    acceptance: AcceptanceConfig = field(default_factory=AcceptanceConfig)
    """When a match is credible."""

    def __post_init__(self) -> None:
        for name in ("length", "window", "max_distance"):
            value = getattr(self, name)
            require(value > 0, f"mbicp.{name} must be positive, found {value}")
        for name in ("trim", "final_trim"):
            value = getattr(self, name)
            require(0 < value <= 1, f"mbicp.{name} must lie in (0, 1], found {value}")
        require(self.max_iterations >= 1, f"mbicp.max_iterations must be at least 1, found {self.max_iterations}")


class MbicpMatcher(SingleScanMatcher):
    """Closest points on the reference's surface and least squares, both in the metric of shift and turn.

    Covariance: that of the least squares over the last pairs, with the residual's variance.
    """

    def __init__(self, config: MbicpConfig | None = None) -> None:
        self.config = config or MbicpConfig()
        super().__init__(self.config.acceptance, self.config.max_gap)

    def _align(self, reference: ReferenceScan, points: BearingScan, T_frame_guess: NDArray[np.float64]) -> Alignment:
        config = self.config
        pose, hessian, scatter, (pairs, square, iterations) = kernels.mbicp(
            reference.points.xy,
            reference.points.bearings,
            reference.linked,
            points.xy,
            T_frame_guess,
            config.length,
            config.window,
            config.max_distance,
            config.trim,
            config.final_trim,
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
        )
