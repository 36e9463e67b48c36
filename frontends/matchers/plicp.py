"""PLICP: ICP with a point-to-line metric (Censi 2008)."""

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
class PlicpConfig(PairConfig):
    """Settings of PLICP."""

    damping: float = 1e-3
    """Pull towards the last pose where the lines leave it free, in correspondences per correspondence."""
    adaptive_factor: float = 2.0
    epsilon: float = 1e-5
    strict_first: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.damping > 0, f"damping must be positive, found {self.damping}")


class PlicpMatcher(SingleScanMatcher):
    """Minimises the distances of the points to the lines through the nearest pieces of the reference."""

    def __init__(self, config: PlicpConfig | None = None) -> None:
        self.config = config or PlicpConfig()
        super().__init__(self.config)

    def _iterate(
        self,
        outline: Outline,
        points: NDArray[np.float64],
        start: NDArray[np.float64],
        trimming: Trimming,
        stopping: Stopping,
    ) -> tuple[NDArray[np.float64], Pairs, int]:
        return kernels.closest_lines(outline, points, start, self.config.damping, trimming, stopping)
