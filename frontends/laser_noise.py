"""The noise of a laser, learned from its own scans before anything is mapped.

On a straight wall the range of a beam follows from those of its two neighbours: 1/r is linear in the cosine and sine of
the bearing, so the middle one of three is their harmonic mean times the cosine of the spacing. What is left over is
noise, whatever the incidence, except where the three beams do not meet one wall. Such triples lie far off and spread
widely, so a Gaussian that is fitted to the core of the residuals alone hardly sees them.
"""

import math
from dataclasses import dataclass
from math import exp, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log, ScanGeometry
from graph.errors import IcegError

_SCANS = 150
"""Scans, spread over the log, that tell."""
_BINS, _FEWEST = 6, 200
"""Residuals are sorted by range into so many bins of as many each, but no fewer than this."""
_CORE = 2.0
"""Residuals within so many standard deviations make up the core. With 1.5 or 3, the estimate of a clean wall scatters
by a fifth more, or a tenth of wide outliers raises it by a tenth."""
_CORE_SHARE = 2.0 * 0.4772498680518208
"""Of a Gaussian, within `_CORE`."""
_CORE_VARIANCE = 1.0 - 2.0 * _CORE * exp(-0.5 * _CORE * _CORE) / sqrt(2.0 * pi) / _CORE_SHARE
"""Of the core of a unit Gaussian."""
_MEDIAN = 0.6744897501960817
"""Of the absolute value of a unit Gaussian."""
_CORE_ROUNDS, _FIT_ROUNDS = 12, 8
_SLANT_LAG = 5
"""So many beams to either side tell how much a wall slants, and not of the noise of the three in the middle …"""
_SQUARE = 0.3
"""… which count if its range changes by no more than this per radian and metre of range: on a slanting wall, what
sticks out of it passes for noise. Recorded logs err by the same at 45° to within a fifth or so, a simulated one whose
walls are made of cells by 6 times as much."""
_ALONE = 6.0
"""A return so many standard deviations off a wall that those on either side of it agree on is an outlier …"""
_AGREED = 3.0
"""… and they agree where they predict it within so many of each other."""
_LEAST_STEP = 1e-4
"""Finer steps of the readings are none [m]."""


class LaserNoiseError(IcegError):
    """A noise that no laser has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserNoise:
    """How far the ranges of a laser scatter.

    Attributes:
        constant: standard deviation of a short range, steps of the readings included [m].
        per_metre: what grows with the range: σ(r)² = constant² + (per_metre · r)².
        typical_range: median of the ranges [m].
        outlier_share: of the returns, lie alone off the wall that their neighbours see.
        no_return_share: of the beams.
        step: of the readings, as recorded [m]; 0 for none.
    """

    constant: float
    per_metre: float = 0.0
    typical_range: float = 4.0
    outlier_share: float = 0.0
    no_return_share: float = 0.0
    step: float = 0.0

    def __post_init__(self) -> None:
        if not (self.constant >= 0 and self.per_metre >= 0):
            raise LaserNoiseError(
                f"laser noise: found {self.constant} m and {self.per_metre} per metre, expected neither to be negative"
            )

    @property
    def typical(self) -> float:
        """Standard deviation at the typical range [m]."""
        return sqrt(self.constant**2 + (self.per_metre * self.typical_range) ** 2)


def learn_laser_noise(log: Log) -> LaserNoise | None:
    """Learn the noise of the laser of a log.

    Simulated walls, corners and jumps included, give σ(r) within 10 % from 5 mm to 0.3 m.

    Args:
        log: the log.

    Returns:
        The noise; None where too few beams meet walls to tell.
    """
    ranges = log.ranges[:: max(1, len(log) // _SCANS)].astype(np.float64)
    usable = ranges[np.isfinite(ranges)]
    step = _step(usable)
    rng = np.random.default_rng(0)  # steps would make medians jump: readings are spread over them at random
    ranges += step * (rng.random(ranges.shape) - 0.5)
    residuals, predicted = _residuals(ranges, log.geometry, 1)
    inner = slice(_SLANT_LAG - 1, 1 - _SLANT_LAG)
    residuals, predicted = residuals[:, inner], predicted[:, inner]
    known = np.isfinite(residuals) & (_slants(ranges, log.geometry, _SLANT_LAG) < _SQUARE * predicted)
    if np.count_nonzero(known) < 2 * _FEWEST:
        return None
    constant2, per_metre2 = _fit(*_scatter(np.abs(residuals[known]), predicted[known]))
    constant2 = max(constant2 - step * step / 12.0, step * step / 12.0)
    return LaserNoise(
        constant=sqrt(constant2),
        per_metre=sqrt(per_metre2),
        typical_range=float(np.median(usable)),
        outlier_share=_outlier_share(ranges, log.geometry, constant2 + step * step / 12.0, per_metre2),
        no_return_share=1.0 - len(usable) / ranges.size,
        step=step,
    )


def _step(ranges: NDArray[np.float64]) -> float:
    """The step in which (n,) ranges are recorded, 0 where there is none."""
    gaps = np.diff(np.unique(np.round(ranges, 5)))
    if len(gaps) < _FEWEST:
        return 0.0
    step = float(np.quantile(gaps, 0.1))
    if step < _LEAST_STEP:
        return 0.0
    return step if float(np.mean(np.abs(ranges / step - np.round(ranges / step)) < 0.1)) > 0.9 else 0.0


def _residuals(
    ranges: NDArray[np.float64], geometry: ScanGeometry, lag: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Each range less what the beams `lag` to either side predict, in standard deviations of one range; and the latter.

    Args:
        ranges: (n, n_beams) [m], NaN without return.
        geometry: of the laser.
        lag: in beams.

    Returns:
        (n, n_beams - 2 lag) each [m]; NaN where one of the three has no return.
    """
    left, middle, right = ranges[:, : -2 * lag], ranges[:, lag:-lag], ranges[:, 2 * lag :]
    cosine, both = math.cos(lag * geometry.resolution), left + right
    predicted = 2.0 * cosine * left * right / both
    # How the prediction changes with either neighbour.
    by_left, by_right = 2.0 * cosine * (right / both) ** 2, 2.0 * cosine * (left / both) ** 2
    return (middle - predicted) / np.sqrt(1.0 + by_left**2 + by_right**2), predicted


def _slants(ranges: NDArray[np.float64], geometry: ScanGeometry, lag: int) -> NDArray[np.float64]:
    """(n, n_beams - 2 lag) change of (n, n_beams) ranges with the bearing [m/rad], NaN where a beam is missing."""
    return np.abs(ranges[:, 2 * lag :] - ranges[:, : -2 * lag]) / (2 * lag * geometry.resolution)


def _scatter(
    sizes: NDArray[np.float64], ranges: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean squared range [m²], variance [m²] and number of the residuals in bins of range.

    Args:
        sizes: (n,) of residuals [m].
        ranges: (n,) [m].

    Returns:
        (b,) each.
    """
    order = np.argsort(ranges, kind="stable")
    bins = np.array_split(order, max(1, min(_BINS, len(order) // _FEWEST)))
    squares = np.array([np.mean(ranges[one] ** 2) for one in bins])
    variances = np.array([_core_variance(sizes[one]) for one in bins])
    return squares, variances, np.array([float(len(one)) for one in bins])


def _core_variance(sizes: NDArray[np.float64]) -> float:
    """Variance of a Gaussian whose core is that of residuals of (n,) sizes; what lies far off does not count."""
    sigma = float(np.median(sizes)) / _MEDIAN
    for _ in range(_CORE_ROUNDS):
        core = sizes[sizes < _CORE * sigma]
        if len(core) == 0:
            return sigma * sigma
        sigma = sqrt(float(np.mean(core * core)) / _CORE_VARIANCE)
    return sigma * sigma


def _fit(
    squares: NDArray[np.float64], variances: NDArray[np.float64], counts: NDArray[np.float64]
) -> tuple[float, float]:
    """Constant and slope, neither negative, of variances over squared ranges; each is known to a share of itself."""
    constant, slope = float(np.mean(variances)), 0.0
    for _ in range(_FIT_ROUNDS):
        weights = counts / np.maximum(constant + slope * squares, 1e-12) ** 2
        total = float(weights.sum())
        mean_x, mean_y = float((weights * squares).sum()) / total, float((weights * variances).sum()) / total
        spread = float((weights * (squares - mean_x) ** 2).sum())
        slope = float((weights * (squares - mean_x) * variances).sum()) / spread if spread > 0.0 else 0.0
        slope = max(0.0, slope)
        constant = mean_y - slope * mean_x
        if constant < 0.0:
            constant = 0.0
            slope = float((weights * squares * variances).sum()) / float((weights * squares**2).sum())
    return constant, slope


def _outlier_share(ranges: NDArray[np.float64], geometry: ScanGeometry, constant2: float, per_metre2: float) -> float:
    """Share of the returns that lie alone off a straight wall."""
    near, by_near = _residuals(ranges, geometry, 1)
    _, by_far = _residuals(ranges, geometry, 2)
    near, by_near = near[:, 1:-1], by_near[:, 1:-1]
    sigma = np.sqrt(constant2 + per_metre2 * by_far**2)
    agreed = np.abs(by_near - by_far) < _AGREED * sigma
    if not agreed.any():
        return 0.0
    return float(np.mean(np.abs(near[agreed]) > _ALONE * sigma[agreed]))
