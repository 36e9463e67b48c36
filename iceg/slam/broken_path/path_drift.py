"""How probable the errors of a path make it that parts of it lie elsewhere, against that a robot was carried there."""

from collections.abc import Sequence
from math import log, pi

import numpy as np

from graph.arrays import Floats
from graph.consistency import cumulative_covariances
from graph.dense import cholesky, vecdot
from graph.factors import Factor
from graph.noise import squared_norm
from graph.se2 import logmap
from iceg.slam.broken_path.displacement import variance_of_place
from iceg.slam.closures.attempt import Attempt, implied_correction


class PathDrift:
    """The errors of a path are normally distributed; who is carried may be anywhere along it, and look anywhere."""

    def __init__(self, path: Sequence[Factor], poses: Floats, factor: float) -> None:
        """Add up the errors.

        Args:
            path: the factors from key pose to key pose.
            poses: (k, 3) T_map_robot.
            factor: on their standard deviations.
        """
        self._poses = poses
        self._cumulative = cumulative_covariances(path, poses) * factor**2
        self._apart = variance_of_place(poses)

    def log_ratio(self, closures: Sequence[Attempt]) -> float:
        """How many times as probable the errors make what closures say as a robot that was carried, the logarithm."""
        errors = [logmap(implied_correction(closure, self._poses)) for closure in closures]
        return float(np.median([self._log_ratio(*c.pair, e) for c, e in zip(closures, errors, strict=True)]))

    def log_precision(self, key_old: int, key_new: int) -> float:
        """How many times as small the errors of a key pose seen from another are as the place of a carried robot."""
        return max(self._log_ratio(key_old, key_new, np.zeros(3)), 0.0)

    def _log_ratio(self, key_old: int, key_new: int, error: Floats) -> float:
        covariance = self._cumulative[key_new] - self._cumulative[key_old]
        drifted = -0.5 * (squared_norm(error, covariance) + _log_determinant(2.0 * pi * covariance))
        carried = -0.5 * vecdot(error[:2], error[:2]) / self._apart - log(2.0 * pi * self._apart) - log(2.0 * pi)
        return drifted - carried


def _log_determinant(covariance: Floats) -> float:
    """Of a symmetric, positive definite matrix."""
    return 2.0 * sum(log(each) for each in np.diagonal(cholesky(covariance)).tolist())
