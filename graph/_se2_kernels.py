"""Many poses at a time, compiled: digit for digit what `graph.se2` says of one pair."""

from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

Floats = NDArray[np.float64]


@compiled
def pair_up(first: Floats, second: Floats, back: bool, out: Floats) -> None:
    """Put into `out` (n, 3), of (n or 1, 3) poses, `compose(first, second)`, or `between(first, second)` if `back`."""
    for k in range(len(out)):
        a, b = first[k if len(first) > 1 else 0], second[k if len(second) > 1 else 0]
        c, s = cos(a[2]), sin(a[2])
        if back:
            dx, dy = b[0] - a[0], b[1] - a[1]
            out[k, 0], out[k, 1], out[k, 2] = c * dx + s * dy, c * dy - s * dx, _wrap(b[2] - a[2])
        else:
            out[k, 0] = a[0] + c * b[0] - s * b[1]
            out[k, 1] = a[1] + s * b[0] + c * b[1]
            out[k, 2] = _wrap(a[2] + b[2])


@compiled
def _wrap(angle: float) -> float:
    """An angle [rad] brought into (−π, π]."""
    wrapped: float = np.fmod(angle, 2.0 * pi)
    if wrapped > pi:
        wrapped -= 2.0 * pi
    return wrapped + 2.0 * pi if wrapped <= -pi else wrapped
