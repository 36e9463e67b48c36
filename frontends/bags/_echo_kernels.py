"""The first echo of each beam out of a list of lists, compiled."""

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled


@compiled
def first_echoes(counts: NDArray[np.uint32], echoes: NDArray[np.float32], ranges: NDArray[np.float32]) -> int:
    """Take the first echo of each beam, NaN where there is none.

    Args:
        counts: (k,) words of 32 bits: of each beam how many echoes it has, and these, …
        echoes: … the same words as numbers.
        ranges: (n_beams,) to be filled.

    Returns:
        How many words the beams took; more than there are where the message ends too early.
    """
    place = 0
    for beam in range(len(ranges)):
        if place >= len(counts):
            return len(counts) + 1
        n_echoes = int(np.int64(counts[place]))
        if n_echoes >= len(counts) - place:
            return len(counts) + 1
        ranges[beam] = echoes[place + 1] if n_echoes > 0 else np.nan
        place += 1 + n_echoes
    return place
