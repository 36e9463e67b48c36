"""Polish of a hypothesis: on all points (point to line) or on the coinciding features."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iceg.ice import _field_kernels as field_kernels
from iceg.ice import _hypothesis_kernels as hypothesis_kernels
from iceg.ice.config import RefinementConfig
from iceg.ice.features import FeatureRows
from iceg.ice.local_map import LocalMap
from iceg.ice.points import ScanPoints

FACING = 0.3
"""Least cosine between the normals of a point and of its surfel."""
_ANY_FACING = -2.0
_COARSE_ITERATIONS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Refined:
    """A polished pose.

    Attributes:
        T_ref_cur: (3,) the pose.
        inliers: points (or features) that agree.
        used: points (or features) that found a partner.
        residual: weighted root mean square of the point-to-line distances [m]; NaN for features.
        hessian: (3, 3) Σ w JᵀJ in the reference frame, rotation about the robot; unit residual variance for points.
    """

    T_ref_cur: NDArray[np.float64]
    inliers: int
    used: int
    residual: float
    hessian: NDArray[np.float64]


def refine_on_points(
    scan_points: ScanPoints,
    local_map: LocalMap,
    T_ref_start: NDArray[np.float64],
    config: RefinementConfig,
    *,
    wide: bool,
    prior_weight: float = 1e-3,
) -> Refined:
    """Gauss-Newton on point-to-line distances with Cauchy weights.

    Args:
        scan_points: points of the new scan.
        local_map: the reference.
        T_ref_start: (3,) start.
        config: widths and iterations.
        wide: first converge on the wide field, from up to about a metre off.
        prior_weight: strength of a pull towards the start, in points per squared residual.

    Returns:
        The pose with its inliers.
    """
    start = T_ref_start
    if wide:
        start = _descend(
            scan_points, local_map, start, config.coarse_scale, 0.15, _COARSE_ITERATIONS, prior_weight, coarse=True
        ).T_ref_cur
    return _descend(
        scan_points, local_map, start, 4 * config.scale, config.scale, config.iterations, prior_weight, coarse=False
    )


def evaluate_points(
    scan_points: ScanPoints, local_map: LocalMap, T_ref_cur: NDArray[np.float64], config: RefinementConfig
) -> Refined:
    """Inliers of a given pose, without moving it."""
    return _descend(scan_points, local_map, T_ref_cur, config.scale, 2 * config.scale, 0, 0.0, coarse=False)


def _descend(
    scan_points: ScanPoints,
    local_map: LocalMap,
    start: NDArray[np.float64],
    scale0: float,
    scale: float,
    iterations: int,
    prior_weight: float,
    *,
    coarse: bool,
) -> Refined:
    field = local_map.coarse if coarse else local_map.fine
    pose, hessian = np.empty(3), np.empty((3, 3))
    inliers, used, residual = field_kernels.refine(
        scan_points.points,
        scan_points.normals,
        start,
        local_map.surfels,
        field.nearest,
        field.origin,
        field.cell,
        scale0,
        scale,
        iterations,
        prior_weight,
        _ANY_FACING if coarse else FACING,
        pose,
        hessian,
    )
    return Refined(T_ref_cur=pose, inliers=inliers, used=used, residual=residual, hessian=hessian)


def polish_on_features(
    features: FeatureRows, reference: FeatureRows, T_ref_start: NDArray[np.float64], iterations: int = 8
) -> Refined:
    """Least squares over the coinciding features, each weighed by both covariances (ICE without points).

    Args:
        features: features of the new scan.
        reference: features of the local map.
        T_ref_start: (3,) start.
        iterations: most Gauss-Newton steps.

    Returns:
        The pose; its hessian is an information matrix.
    """
    pose, hessian = np.empty(3), np.empty((3, 3))
    hit = hypothesis_kernels.polish_on_features(
        features.kinds,
        features.rows,
        len(features),
        reference.kinds,
        reference.rows,
        len(reference),
        T_ref_start,
        iterations,
        pose,
        hessian,
    )
    return Refined(T_ref_cur=pose, inliers=hit, used=hit, residual=float("nan"), hessian=hessian)
