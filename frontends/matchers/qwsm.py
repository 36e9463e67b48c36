"""QWSM: weighted scan matching against a quad tree of many scans, on mutual nearest neighbours (Visser et al. 2007)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frontends.matchers.acceptance import AcceptanceConfig
from frontends.matchers.errors import require
from frontends.matchers.weighted import IterationConfig, WeightedMatcher
from frontends.matchers.weighted_points import PointNoiseConfig, WeightedPoints, merged
from frontends.scan import Scan


@dataclass(frozen=True, kw_only=True)
class QwsmConfig:
    """Settings of QWSM."""

    noise: PointNoiseConfig = field(default_factory=PointNoiseConfig)
    """How uncertain each point is."""
    iteration: IterationConfig = field(default_factory=IterationConfig)
    """The weighted least squares."""
    max_scans: int = 25
    """Most earlier scans in the quad tree, the newest ones."""
    reach: float = 30.0
    """Points farther than this from the newest laser are left out [m]."""
    acceptance: AcceptanceConfig = field(default_factory=AcceptanceConfig)
    """When a match is credible."""

    def __post_init__(self) -> None:
        require(self.max_scans >= 1, f"qwsm.max_scans must be at least 1, found {self.max_scans}")
        require(self.reach > 0, f"qwsm.reach must be positive, found {self.reach}")


class QwsmMatcher(WeightedMatcher):
    """Weighted scan matching against all points of the reference."""

    def __init__(self, config: QwsmConfig | None = None) -> None:
        self.config = config or QwsmConfig()
        super().__init__(self.config.noise, self.config.iteration, self.config.acceptance, mutual=True)

    def _place(self, scans: list[Scan], T_ref_lasers: NDArray[np.float64]) -> WeightedPoints:
        newest = self.config.max_scans
        weighed = [self._points_of(scan) for scan in scans[-newest:]]
        return merged(weighed, T_ref_lasers[-newest:], self.config.reach)
