"""WSM: weighted scan matching (Pfister, Roumeliotis and Burdick 2002, 2007)."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from frontends.matchers.acceptance import AcceptanceConfig
from frontends.matchers.weighted import IterationConfig, WeightedMatcher
from frontends.matchers.weighted_points import PointNoiseConfig, WeightedPoints
from frontends.scan import Scan


@dataclass(frozen=True, kw_only=True)
class WsmConfig:
    """Settings of WSM."""

    noise: PointNoiseConfig = field(default_factory=PointNoiseConfig)
    """How uncertain each point is."""
    iteration: IterationConfig = field(default_factory=lambda: IterationConfig(trim=0.9))
    """The weighted least squares."""
    acceptance: AcceptanceConfig = field(default_factory=AcceptanceConfig)
    """When a match is credible."""


class WsmMatcher(WeightedMatcher):
    """Weighted scan matching against the newest scan of the reference."""

    def __init__(self, config: WsmConfig | None = None) -> None:
        self.config = config or WsmConfig()
        super().__init__(self.config.noise, self.config.iteration, self.config.acceptance, mutual=False)

    def _place(self, scans: list[Scan], T_ref_lasers: NDArray[np.float64]) -> WeightedPoints:
        return replace(self._points_of(scans[-1]), T_ref_laser=T_ref_lasers[-1])
