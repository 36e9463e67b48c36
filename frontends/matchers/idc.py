"""IDC: iterative dual correspondence (Lu and Milios 1997)."""

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
class IdcConfig:
    """Settings of IDC."""

    window: float = math.radians(60.0)
    """Correspondences are sought this far to either side of a point's bearing at first [rad] …"""
    decay: float = 0.2
    """… narrowing as exp(−decay · iteration) …"""
    min_window: float = math.radians(5.0)
    """… down to this [rad]."""
    max_distance: float = 1.0
    """Farthest closest point, and largest difference of matching ranges [m]."""
    trim: float = 0.95
    """Share of the correspondences of either rule kept in each iteration, the best ones …"""
    final_trim: float = 0.85
    """… and once the iterations have settled: far from the optimum too many would be lost."""
    max_iterations: int = 40
    """Most iterations; the two rules share no cost, so a few scans end in a small cycle."""
    epsilon: float = 2e-4
    """The iterations end when none of them moves the scan farther than this [m, rad]."""
    max_gap: float = 0.5
    """Neighbouring points nearer than this are joined by a straight piece of surface [m]."""
    acceptance: AcceptanceConfig = field(default_factory=AcceptanceConfig)
    """When a match is credible."""

    def __post_init__(self) -> None:
        require(0 < self.min_window <= self.window, "idc: need 0 < min_window <= window")
        require(self.decay > 0, f"idc.decay must be positive, found {self.decay}")
        require(self.max_distance > 0, f"idc.max_distance must be positive, found {self.max_distance}")
        for name in ("trim", "final_trim"):
            value = getattr(self, name)
            require(0 < value <= 1, f"idc.{name} must lie in (0, 1], found {value}")
        require(self.max_iterations >= 1, f"idc.max_iterations must be at least 1, found {self.max_iterations}")


class IdcMatcher(SingleScanMatcher):
    """Takes the translation from closest points and the rotation from points at matching range.

    Covariance: the paper's closed form over the last closest points.
    """

    def __init__(self, config: IdcConfig | None = None) -> None:
        self.config = config or IdcConfig()
        super().__init__(self.config.acceptance, self.config.max_gap)

    def _align(self, reference: ReferenceScan, points: BearingScan, T_frame_guess: NDArray[np.float64]) -> Alignment:
        config = self.config
        pose, hessian, scatter, (pairs, square, iterations) = kernels.idc(
            reference.points.xy,
            reference.points.bearings,
            reference.linked,
            points.xy,
            T_frame_guess,
            config.window,
            config.decay,
            config.min_window,
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
