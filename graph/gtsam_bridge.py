"""The one place where records become GTSAM objects and back."""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any, Literal

import gtsam
import numpy as np
from numpy.typing import NDArray

from graph.factors import Factor, KernelName, RobustKernel
from graph.se2 import wrap_angle

_ESTIMATORS: dict[KernelName, Any] = {
    "huber": gtsam.noiseModel.mEstimator.Huber,
    "cauchy": gtsam.noiseModel.mEstimator.Cauchy,
    "geman_mcclure": gtsam.noiseModel.mEstimator.GemanMcClure,
    "dcs": gtsam.noiseModel.mEstimator.DCS,
}


def to_gtsam_factor(factor: Factor) -> gtsam.NonlinearFactor:
    """The GTSAM factor of a record; keys are the indices of the poses."""
    noise = to_gtsam_noise(factor.covariance, factor.kernel)
    measured = to_gtsam_pose(factor.T_i_j)
    if factor.i is None:
        return gtsam.PriorFactorPose2(factor.j, measured, noise)
    return gtsam.BetweenFactorPose2(factor.i, factor.j, measured, noise)


def to_gtsam_graph(factors: Iterable[Factor]) -> gtsam.NonlinearFactorGraph:
    """A new GTSAM graph of the records, in their order."""
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(to_gtsam_factor(factor))
    return graph


def to_gtsam_noise(
    covariance: NDArray[np.float64], kernel: RobustKernel | None
) -> gtsam.noiseModel.Gaussian | gtsam.noiseModel.Robust:
    """The GTSAM noise model of a (3, 3) covariance that `graph.noise.conditioned` has passed."""
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    return noise if kernel is None else gtsam.noiseModel.Robust.Create(_estimator(kernel), noise)


def to_gtsam_pose(T_a_b: NDArray[np.float64]) -> gtsam.Pose2:
    """The GTSAM pose of a (3,) array."""
    x, y, heading = T_a_b.tolist()
    return gtsam.Pose2(x, y, heading)


def to_gtsam_values(poses: NDArray[np.float64], first_key: int = 0) -> gtsam.Values:
    """GTSAM values of (n, 3) poses, keys counted up from `first_key`."""
    values = gtsam.Values()
    for key, (x, y, heading) in enumerate(poses.tolist(), start=first_key):
        values.insert(key, gtsam.Pose2(x, y, heading))
    return values


def from_gtsam_pose(pose: gtsam.Pose2) -> NDArray[np.float64]:
    """The (3,) array of a GTSAM pose."""
    return np.array((pose.x(), pose.y(), wrap_angle(pose.theta())))


def from_gtsam_values(values: gtsam.Values) -> NDArray[np.float64]:
    """(n, 3) poses of GTSAM values whose keys are 0 … n−1."""
    poses = np.array(gtsam.utilities.extractPose2(values), dtype=np.float64, order="C")
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


def new_isam(
    factorization: Literal["CHOLESKY", "QR"], *, relinearize_threshold: float = 0.1, relinearize_skip: int = 10
) -> gtsam.ISAM2:
    """An empty iSAM2 (Gauss-Newton steps)."""
    params = gtsam.ISAM2Params()
    params.setFactorization(factorization)
    params.setRelinearizeThreshold(relinearize_threshold)
    params.relinearizeSkip = relinearize_skip
    return gtsam.ISAM2(params)


@lru_cache
def _estimator(kernel: RobustKernel) -> Any:  # noqa: ANN401  GTSAM's estimators share no stub type
    return _ESTIMATORS[kernel.name].Create(kernel.width)
