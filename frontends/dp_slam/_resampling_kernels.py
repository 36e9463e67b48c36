"""Resampling, compiled: which samples become the particles of the next generation."""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled


@compiled
def resample(
    weights: NDArray[np.float64], uniforms: NDArray[np.float64], n_particles: int, times: NDArray[np.int64]
) -> None:
    """How often each sample is drawn; once `n_particles` different ones are, further draws are among these.

    Args:
        weights: (n,) not negative.
        uniforms: (draws,) in [0, 1).
        n_particles: most different samples.
        times: (n,) filled.
    """
    times[:] = 0
    kept = weights.copy()
    total = kept.sum()
    distinct = 0
    for draw in range(len(uniforms)):
        left = uniforms[draw] * total
        chosen = -1
        for sample in range(len(kept)):
            if kept[sample] > 0.0:
                chosen = sample
                left -= kept[sample]
                if left < 0.0:
                    break
        distinct += times[chosen] == 0
        times[chosen] += 1
        if distinct == n_particles:
            for sample in range(len(kept)):
                if times[sample] == 0:
                    kept[sample] = 0.0
            total = kept.sum()
            distinct += 1
