"""Elementary functions of arrays with the same digits on every processor.

NumPy computes these many numbers at a time where the processor can, by other approximations than where it cannot; the
last digits differ. Here, each number is the mathematical library's own.
"""

import numpy as np
from numpy.typing import ArrayLike

from graph.arrays import Floats


def cos_sin(angles: ArrayLike) -> tuple[Floats, Floats]:
    """Cosines and sines.

    Args:
        angles: (...) [rad].

    Returns:
        (...) and (...).
    """
    from graph import _elementary_kernels as kernels

    angles = np.asarray(angles, dtype=np.float64)
    cos, sin = np.empty((2, angles.size))
    kernels.cos_sin(angles.ravel(), cos, sin)
    return cos.reshape(angles.shape), sin.reshape(angles.shape)


def arctan2(y: ArrayLike, x: ArrayLike) -> Floats:
    """(...) bearings [rad] in [−π, π] of points whose coordinates broadcast."""
    from graph import _elementary_kernels as kernels

    bearings = np.empty(np.broadcast_shapes(np.shape(y), np.shape(x)))
    flat_y, flat_x = (np.array(np.broadcast_to(side, bearings.shape), dtype=np.float64).ravel() for side in (y, x))
    kernels.arctan2(flat_y, flat_x, bearings.reshape(-1))
    return bearings


def exp(x: ArrayLike) -> Floats:
    """(...) e to the power of (...) numbers."""
    from graph import _elementary_kernels as kernels

    x = np.asarray(x, dtype=np.float64)
    powers = np.empty(x.size)
    kernels.exp(np.ascontiguousarray(x).ravel(), powers)
    return powers.reshape(x.shape)


def log(x: ArrayLike) -> Floats:
    """(...) natural logarithms of (...) numbers: −∞ of zero, NaN of negative ones."""
    from graph import _elementary_kernels as kernels

    x = np.asarray(x, dtype=np.float64)
    logarithms = np.empty(x.size)
    kernels.log(np.ascontiguousarray(x).ravel(), logarithms)
    return logarithms.reshape(x.shape)
