"""ICP: iterative closest point, point to point, trimmed (Besl and McKay 1992; Chetverikov et al. 2002)."""

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
class IcpConfig:
    """Settings of ICP."""

    max_distance: float = 2.0
    """Farthest correspondence [m]."""
    trim: float = 0.95
    """Share of the correspondences kept in each iteration, the nearest ones …"""
    final_trim: float = 0.85
    """… and once the iterations have settled: far from the optimum too many would be lost."""
    max_iterations: int = 80
    """Most iterations."""
    epsilon: float = 1e-4
    """The iterations end when none of them moves the scan farther than this [m, rad]."""
    max_gap: float = 0.5
    """Neighbouring points nearer than this are taken as one surface when agreement is counted [m]."""
    acceptance: AcceptanceConfig = field(default_factory=AcceptanceConfig)
    """When a match is credible."""

    def __post_init__(self) -> None:
        require(self.max_distance > 0, f"icp.max_distance must be positive, found {self.max_distance}")
        for name in ("trim", "final_trim"):
            value = getattr(self, name)
            require(0 < value <= 1, f"icp.{name} must lie in (0, 1], found {value}")
        require(self.max_iterations >= 1, f"icp.max_iterations must be at least 1, found {self.max_iterations}")


class IcpMatcher(SingleScanMatcher):
    """Pairs each point with the closest of the reference and fits the pairs rigidly, until nothing moves.

    Covariance: that of the least squares over the last pairs, with the residual's variance.
    """

    def __init__(self, config: IcpConfig | None = None) -> None:
        self.config = config or IcpConfig()
        super().__init__(self.config.acceptance, self.config.max_gap)

    def _align(self, reference: ReferenceScan, points: BearingScan, T_frame_guess: NDArray[np.float64]) -> Alignment:
        config = self.config
        pose, hessian, scatter, (pairs, square, iterations) = kernels.icp(
            reference.points.xy,
            reference.points.bearings,
            points.xy,
            T_frame_guess,
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
