"""Two tables of the same cells: what changed, and whether that is chance.

A run near the edge ends well or badly by a millimetre of noise. So two versions differ in some cells even if neither is
better; but then each difference might as well have had the other sign. How often do random signs give a sum as far from
zero as the one found? That is Fisher's sign-flip test (*The Design of Experiments*, 1935, section 21): it assumes
nothing of how differences are distributed, and a single cell that goes from 7 cm to 19 m proves no more than one cell
can. For differences of ±1, as of runs that are ruined before or after, it is McNemar's exact test. Cells that differ by
their noise alone are one sample together.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from graph.elementary import log

_EXACT = 16
"""So many differences are flipped in every way; more of them at random …"""
_FLIPS = 20_000
"""… so many times …"""
_SEED = 0
"""… which are the same every time."""
_RESAMPLED = 2_000
"""Samples that the bootstrap draws."""
_ROUNDING = 1e-9


def by_family(values: Iterable[tuple[str, float]]) -> NDArray[np.float64]:
    """(m,) sums over the cells of each family, in the order of the families' first cells."""
    sums: dict[str, float] = {}
    for family, value in values:
        sums[family] = sums.get(family, 0.0) + value
    return np.array(list(sums.values()))


def chance(differences: NDArray[np.float64]) -> float:
    """Probability that random signs give a sum at least as far from zero.

    Args:
        differences: (m,) of independent samples; those that are zero say nothing.

    Returns:
        Two-sided probability in (0, 1]; 1 where nothing differs.
    """
    telling = differences[differences != 0.0]
    if not len(telling):
        return 1.0
    least = abs(math.fsum(telling.tolist())) - _ROUNDING * float(np.abs(telling).sum())
    sums = _all_signs(telling) if len(telling) <= _EXACT else _random_signs(telling)
    as_far = int(np.count_nonzero(np.abs(sums) >= least))
    if len(telling) <= _EXACT:
        return as_far / len(sums)
    return (as_far + 1) / (len(sums) + 1)


def scatter(errors: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Standard deviation of the logarithm of the error over the noise of each family; of several cells at least."""
    logs = {family: log(np.array(values)) for family, values in errors.items() if len(values) > 1}
    return {family: float(values.std(ddof=1)) for family, values in logs.items()}


def interval(logs: NDArray[np.float64], counts: NDArray[np.float64], probability: float = 0.95) -> tuple[float, float]:
    """Bootstrap interval of the geometric mean ratio.

    Args:
        logs: (m,) logarithms of the ratios, summed over each of m independent samples …
        counts: (m,) … of so many cells.
        probability: that it is to hold.

    Returns:
        Its ends: percentiles of the means over samples drawn with replacement, as ratios.
    """
    rng = np.random.default_rng(_SEED)
    drawn = rng.integers(len(logs), size=(_RESAMPLED, len(logs)))
    means = logs[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, [0.5 - 0.5 * probability, 0.5 + 0.5 * probability])
    return math.exp(low), math.exp(high)


def _all_signs(differences: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2^m,) sums."""
    sums = np.zeros(1)
    for difference in differences.tolist():
        sums = np.concatenate([sums + difference, sums - difference])
    return sums


def _random_signs(differences: NDArray[np.float64]) -> NDArray[np.float64]:
    rng = np.random.default_rng(_SEED)
    sums = np.zeros(_FLIPS)
    for difference in differences.tolist():
        sums += difference * (2.0 * rng.integers(0, 2, _FLIPS) - 1.0)
    return sums
