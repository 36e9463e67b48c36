"""IDC: iterative dual correspondence (Lu and Milios 1997)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _icp_kernels as kernels
from frontends.matchers._icp_kernels import Stopping
from frontends.matchers._outline_kernels import Outline
from frontends.matchers._pair_kernels import Pairs, Trimming
from frontends.matchers.errors import require
from frontends.matchers.single_scan import PairConfig, SingleScanMatcher


@dataclass(frozen=True, kw_only=True)
class IdcConfig(PairConfig):
    """Settings of IDC."""

    window: float = math.radians(60.0)
    """Correspondences are sought this far to either side of a point's bearing at first [rad] …"""
    decay: float = 0.2
    """… narrowing as exp(−decay · iteration) …"""
    min_window: float = math.radians(2.5)
    """… down to this [rad]."""
    max_iterations: int = 40
    adaptive_factor: float = 2.0
    epsilon: float = 2e-4
    strict_first: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require(0 < self.min_window <= self.window, "idc: need 0 < min_window <= window")
        require(self.decay > 0, f"decay must be positive, found {self.decay}")


class IdcMatcher(SingleScanMatcher):
    """Takes the translation from closest places and the rotation from places at matching range."""

    def __init__(self, config: IdcConfig | None = None) -> None:
        self.config = config or IdcConfig()
        super().__init__(self.config)

    def _iterate(
        self,
        outline: Outline,
        points: NDArray[np.float64],
        start: NDArray[np.float64],
        trimming: Trimming,
        stopping: Stopping,
    ) -> tuple[NDArray[np.float64], Pairs, int]:
        config = self.config
        window = config.window if math.isinf(trimming.factor) else config.min_window
        return kernels.dual(outline, points, start, window, config.decay, config.min_window, trimming, stopping)
