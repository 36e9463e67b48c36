"""What residuals cost: squared norms, and the losses and weights of robust kernels."""

import numpy as np

from graph.arrays import Floats, Ints
from graph.elementary import log

PLAIN, HUBER, CAUCHY, GEMAN_MCCLURE, DCS = 0, 1, 2, 3, 4
"""Kernels by number."""


def squared_norms(errors: Floats, information: Floats) -> Floats:
    """(m,) eᵀ Ω e of (m, 3) residuals and (m, 3, 3) informations."""
    a, b, c = errors.T
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = information.transpose(1, 2, 0)
    return np.asarray(a * (xx * a + 2.0 * (xy * b + xt * c)) + b * (yy * b + 2.0 * yt * c) + c * tt * c)


def losses_and_weights(squared: Floats, kernel: Ints, width: Floats) -> tuple[Floats, Floats]:
    """Robust losses ρ(e) (½ e² without kernel) and weights ρ′(e) / e.

    Args:
        squared: (m,) e² = eᵀ Ω e.
        kernel: (m,) by number.
        width: (m,) where fading begins.

    Returns:
        (m,) and (m,).
    """
    losses, weights = 0.5 * squared, np.ones_like(squared)
    for kind in np.unique(kernel).tolist():
        at = kernel == kind
        if kind in (HUBER, DCS):
            at &= squared > (width * width if kind == HUBER else width)
        u, k = squared[at], width[at]
        if kind == HUBER:
            losses[at], weights[at] = k * np.sqrt(u) - 0.5 * k * k, k / np.sqrt(u)
        elif kind == CAUCHY:
            losses[at], weights[at] = 0.5 * k * k * log(1.0 + u / (k * k)), k * k / (k * k + u)
        elif kind == GEMAN_MCCLURE:
            shrink = k * k / (k * k + u)
            losses[at], weights[at] = 0.5 * shrink * u, shrink * shrink
        elif kind == DCS:
            shrink = 2.0 * k / (k + u)
            losses[at], weights[at] = 1.5 * k - shrink * k, shrink * shrink
    return losses, weights
