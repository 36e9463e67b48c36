"""The noise of ranges: what is known of it beforehand, and what a scan says of it."""

from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph._sort_kernels import _sort
from graph.compiled import compiled, compiled_for_both

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

_STRETCH = 4
"""Beams to either side that span the chord across which the second difference of a point is taken."""


class RangeNoise(NamedTuple):
    """How far ranges scatter beyond what all else allows for, see `iceg.ice.noise.NoiseScale`.

    Attributes:
        constant: variance of a short range [m²].
        per_metre2: what it grows by, times the squared range.
        allowed: variance that needs no allowance [m²].
        typical: what is beyond it at the typical range [m²].
    """

    constant: float
    per_metre2: float
    allowed: float
    typical: float


@compiled
def _beyond(range2: float, noise: RangeNoise) -> float:
    """Variance of a range, given squared, beyond what is allowed for [m²]."""
    return max(0.0, noise.constant + noise.per_metre2 * range2 - noise.allowed)


@compiled_for_both
def range_noise(points: F64, beams: I32) -> float:
    """Standard deviation of the points across the surfaces they lie on [m].

    The second difference of three neighbouring points, across the chord of a longer stretch, is zero on any straight
    wall, whatever its incidence, and has six times a point's variance; the median ignores corners and jumps.
    """
    n = len(points)
    off = np.empty(n)
    count = 0
    for i in range(_STRETCH, n - _STRETCH):
        a, b = i - _STRETCH, i + _STRETCH
        if beams[b] - beams[a] != 2 * _STRETCH:
            continue
        ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        dx = points[i - 1, 0] - 2.0 * points[i, 0] + points[i + 1, 0]
        dy = points[i - 1, 1] - 2.0 * points[i, 1] + points[i + 1, 1]
        off[count] = abs(ux * dy - uy * dx) / max(hypot(ux, uy), 1e-9)
        count += 1
    if count == 0:
        return 0.0
    _sort(off[:count])
    median: float = 0.5 * (off[(count - 1) // 2] + off[count // 2])
    return median / (0.6745 * sqrt(6.0))
