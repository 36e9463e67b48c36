"""MbICP: ICP in a metric that knows of rotation (Minguez, Montesano and Lamiraux 2006)."""

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
class MbicpConfig(PairConfig):
    """Settings of MbICP."""

    length: float = 3.0
    """L of the metric: a turn of 1 rad counts as much as a shift by this [m]."""
    window: float = math.radians(60.0)
    """Correspondences are sought this far to either side of a point's bearing [rad]."""
    coarse_epsilon: float = 5e-4

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("length", "window"):
            value = getattr(self, name)
            require(value > 0, f"{name} must be positive, found {value}")


class MbicpMatcher(SingleScanMatcher):
    """Closest places on the reference's surface and least squares, both in the metric of shift and turn."""

    def __init__(self, config: MbicpConfig | None = None) -> None:
        self.config = config or MbicpConfig()
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
        return kernels.closest_points(outline, points, start, config.length**2, config.window, trimming, stopping)
