"""Elementary functions of flat arrays, compiled: the mathematical library's own, one number at a time."""

import math

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled

Floats = NDArray[np.float64]


@compiled
def cos_sin(angles: Floats, cos: Floats, sin: Floats) -> None:
    """Cosines and sines of (n,) angles into two arrays."""
    for k in range(len(angles)):
        cos[k], sin[k] = math.cos(angles[k]), math.sin(angles[k])


@compiled
def arctan2(y: Floats, x: Floats, out: Floats) -> None:
    """Bearings of (n,) points."""
    for k in range(len(out)):
        out[k] = math.atan2(y[k], x[k])


@compiled
def exp(x: Floats, out: Floats) -> None:
    """Of (n,) numbers."""
    for k in range(len(out)):
        out[k] = math.exp(x[k])


@compiled
def log(x: Floats, out: Floats) -> None:
    """Of (n,) numbers."""
    for k in range(len(out)):
        out[k] = math.log(x[k]) if x[k] > 0.0 else (-np.inf if x[k] == 0.0 else np.nan)
