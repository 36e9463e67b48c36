"""Linear regression with Student's t for the residuals, and what a likelihood ratio of two of them proves."""

import math
from dataclasses import dataclass

import numpy as np

from graph import dense
from graph.arrays import Floats
from graph.elementary import log
from graph.noise import chi2_tail

_ROUNDS, _SETTLED = 30, 1e-6
"""Most rounds of expectation and maximisation, and relative change of the scale at which they end: what still moves
then is far below the standard deviations."""
_LEAST = 1e-6
"""Least scale of residuals: of a perfect fit the likelihood has no bound."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudentFit:
    """A fit.

    Attributes:
        coefficients: (k,).
        residuals: (n,) values minus what was fitted.
        scale: of the residuals: a standard deviation but for the tails.
        log_likelihood: at the fit.
    """

    coefficients: Floats
    residuals: Floats
    scale: float
    log_likelihood: float


def student_fit(rows: Floats, values: Floats, freedom: float) -> StudentFit:
    """Maximise the likelihood by reweighted least squares (Lange, Little and Taylor 1989).

    Args:
        rows: (n, k) what the coefficients are multiplied by; columns of zeros get the coefficient 0.
        values: (n,), at least one.
        freedom: degrees of freedom of the distribution.
    """
    size = np.sqrt(np.mean(rows**2, axis=0))
    columns = rows / np.where(size > 0.0, size, 1.0)
    weights, residuals, scale = np.ones(len(values)), values, 1.0
    coefficients = np.zeros(rows.shape[1])
    for _ in range(_ROUNDS):
        weighted = (columns * weights[:, None]).T
        coefficients = dense.least_norm_solution(dense.matmul(weighted, columns), dense.matvec(weighted, values))
        residuals = values - dense.matvec(columns, coefficients)
        before, scale = scale, max(_LEAST, math.sqrt(float(np.mean(weights * residuals**2))))
        weights = (freedom + 1.0) / (freedom + (residuals / scale) ** 2)
        if abs(scale - before) < _SETTLED * scale:
            break
    surprise = float(np.sum(log(1.0 + (residuals / scale) ** 2 / freedom)))
    return StudentFit(
        coefficients=coefficients / np.where(size > 0.0, size, 1.0),
        residuals=residuals,
        scale=scale,
        log_likelihood=-len(values) * math.log(scale) - 0.5 * (freedom + 1.0) * surprise,
    )


def chance_of(without: StudentFit, fit: StudentFit, *, freedom: int, tried: int, lags: int) -> float:
    """How probable it is that a fit gains so much where what it rests on has nothing to do with the values.

    Twice the gain of log-likelihood is χ² (Wilks 1938), of as many independent values as there would be if neither
    what is fitted nor what it explains went on as it went (Bartlett 1946).

    Args:
        without: the fit to nothing but what both know.
        fit: the fit.
        freedom: coefficients that it has beyond the other one.
        tried: of how many such fits it is the best (Bonferroni).
        lags: steps over which residuals may persist.

    Returns:
        In [0, 1].
    """
    explained = without.residuals - fit.residuals
    independent = 1.0 / (1.0 + 2.0 * max(0.0, _shared_persistence(without.residuals, explained, lags)))
    gain = max(0.0, 2.0 * (fit.log_likelihood - without.log_likelihood) * independent)
    return min(1.0, tried * chi2_tail(gain, freedom))


def _shared_persistence(a: Floats, b: Floats, lags: int) -> float:
    """Sum of the products of both autocorrelations."""
    energy = dense.vecdot(a, a) * dense.vecdot(b, b)
    if not energy > 0.0:
        return 0.0
    shifts = range(1, min(lags, len(a) - 1) + 1)
    return sum(dense.vecdot(a[lag:], a[:-lag]) * dense.vecdot(b[lag:], b[:-lag]) for lag in shifts) / energy
