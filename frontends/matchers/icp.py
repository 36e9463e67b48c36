"""ICP: iterative closest point, trimmed (Besl and McKay 1992; Chetverikov et al. 2002).

The model of Besl and McKay may be a polyline: a point's partner is the closest place on it, not the closest sample.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _icp_kernels as kernels
from frontends.matchers._icp_kernels import Stopping
from frontends.matchers._outline_kernels import Outline
from frontends.matchers._pair_kernels import Pairs, Trimming
from frontends.matchers.single_scan import PairConfig, SingleScanMatcher


@dataclass(frozen=True, kw_only=True)
class IcpConfig(PairConfig):
    """Settings of ICP."""

    coarse_epsilon: float = 5e-4


class IcpMatcher(SingleScanMatcher):
    """Pairs each point with the closest place of the reference and fits the pairs rigidly, until nothing moves."""

    def __init__(self, config: IcpConfig | None = None) -> None:
        self.config = config or IcpConfig()
        super().__init__(self.config)

    def _iterate(
        self,
        outline: Outline,
        points: NDArray[np.float64],
        start: NDArray[np.float64],
        trimming: Trimming,
        stopping: Stopping,
    ) -> tuple[NDArray[np.float64], Pairs, int]:
        return kernels.closest_points(outline, points, start, math.inf, math.pi, trimming, stopping)
