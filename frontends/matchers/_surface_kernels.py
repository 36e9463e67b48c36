"""How the surfaces of a scan face, compiled."""

import math

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled


@compiled
def facing(points: NDArray[np.float64], link: float) -> tuple[NDArray[np.float64], float]:
    """How the surfaces of a scan face: mean of JJᵀ, J = (n, p×n / r), n the normal at p, r the mean distance.

    Normals are those of the chord between the farthest neighbours within `link`; lone points have none.
    """
    n = len(points)
    reach = 0.0
    for k in range(n):
        reach += math.hypot(points[k, 0], points[k, 1]) / n
    reach = max(reach, 1e-6)
    mean, used = np.zeros((3, 3)), 0
    row = np.empty(3)
    for k in range(n):
        i, j = k, k
        while i > 0 and math.hypot(points[i - 1, 0] - points[k, 0], points[i - 1, 1] - points[k, 1]) < link:
            i -= 1
        while j < n - 1 and math.hypot(points[j + 1, 0] - points[k, 0], points[j + 1, 1] - points[k, 1]) < link:
            j += 1
        dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        length = math.hypot(dx, dy)
        if length < 0.5 * link:
            continue
        row[0], row[1] = -dy / length, dx / length
        row[2] = (points[k, 0] * row[1] - points[k, 1] * row[0]) / reach
        for a in range(3):
            for b in range(3):
                mean[a, b] += row[a] * row[b]
        used += 1
    return mean / max(used, 1), reach
