"""Polish of a hypothesis: on all points (point to line) or on the coinciding features."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graph import dense
from iceg.ice import _hypothesis_kernels as hypothesis_kernels
from iceg.ice import _refinement_kernels as kernels
from iceg.ice.config import RefinementConfig
from iceg.ice.features import FeatureRows
from iceg.ice.local_map import LocalMap, NearestField
from iceg.ice.points import ScanPoints

FACING = 0.3
"""Least cosine between the normals of a point and of its surfel."""
_ANY_FACING = -2.0
_LEAST_TURN = 1e-9
"""A heading is taken to be measured by no less [m²]."""
_COARSE_SCALE = 0.15
_COARSE_ITERATIONS = 10
_COARSE_POINTS = 120
"""The wide stage needs no more points than this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refined:
    """A polished pose, and how the points of the scan lie on the reference there.

    Attributes:
        T_ref_cur: (3,) the pose.
        inliers: points that agree with the reference.
        used: points that found a partner.
        support: sum of the Cauchy weights of these, in points.
        residual: weighted root mean square of the point-to-line distances, as if all points were typical ones [m].
        hessian: (3, 3) Σ w JᵀJ in the reference frame, rotation about the robot; unit variance of a typical point.
    """

    T_ref_cur: NDArray[np.float64]
    inliers: int
    used: int
    support: float
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
    start = approach(scan_points, local_map, T_ref_start, config, prior_weight)[0] if wide else T_ref_start
    return _descend(
        scan_points,
        local_map.fine,
        local_map.surfels,
        start,
        scales=(4 * config.scale, config.scale),
        iterations=config.iterations,
        prior_weight=prior_weight,
        facing=FACING,
        alike=config.alike,
    )


def approach(
    scan_points: ScanPoints,
    local_map: LocalMap,
    T_ref_start: NDArray[np.float64],
    config: RefinementConfig,
    prior_weight: float,
) -> tuple[NDArray[np.float64], float]:
    """The wide stage of `refine_on_points` alone.

    Returns:
        (3,) a pose from which the fine stage converges, and the share of the points used that lie near the reference
        there; how they face does not count.
    """
    every = max(1, len(scan_points) // _COARSE_POINTS)
    refined = _descend(
        scan_points,
        local_map.coarse,
        local_map.surfels,
        T_ref_start,
        scales=(config.coarse_scale, _COARSE_SCALE),
        iterations=_COARSE_ITERATIONS,
        prior_weight=prior_weight,
        facing=_ANY_FACING,
        alike=_ANY_FACING,
        every=every,
    )
    return refined.T_ref_cur, refined.inliers / max(1, -(-len(scan_points) // every))


def evaluate_points(
    scan_points: ScanPoints, local_map: LocalMap, T_ref_cur: NDArray[np.float64], config: RefinementConfig
) -> Refined:
    """How the points lie on the reference at a given (3,) pose, which is not moved."""
    return _descend(
        scan_points,
        local_map.fine,
        local_map.surfels,
        T_ref_cur,
        scales=(config.scale, config.scale),
        iterations=0,
        prior_weight=0.0,
        facing=FACING,
        alike=config.alike,
    )


def position_information(refined: Refined, least_residual: float) -> NDArray[np.float64]:
    """(2, 2) how well the position of a polished pose is measured, in the robot's frame [1/m²], whatever its heading.

    Args:
        refined: the pose.
        least_residual: the residuals are never taken to be smaller [m].
    """
    position, lever, turn = refined.hessian[:2, :2], refined.hessian[:2, 2], refined.hessian[2, 2]
    without_turn = position - np.outer(lever, lever) / max(turn, _LEAST_TURN)  # Schur complement
    c, s = math.cos(refined.T_ref_cur[2]), math.sin(refined.T_ref_cur[2])
    in_robot = dense.congruence(np.array([[c, s], [-s, c]]), without_turn)
    return in_robot / max(refined.residual, least_residual) ** 2


def _descend(
    scan_points: ScanPoints,
    field: NearestField,
    surfels: NDArray[np.float64],
    start: NDArray[np.float64],
    *,
    scales: tuple[float, float],
    iterations: int,
    prior_weight: float,
    facing: float,
    alike: float,
    every: int = 1,
) -> Refined:
    pose, hessian = np.empty(3), np.empty((3, 3))
    inliers, used, support, residual = kernels.refine(
        scan_points.points,
        scan_points.normals,
        scan_points.spreads,
        every,
        start,
        surfels,
        field.nearest,
        field.origin,
        field.cell,
        scales[0],
        scales[1],
        iterations,
        prior_weight,
        facing,
        alike,
        pose,
        hessian,
    )
    return Refined(T_ref_cur=pose, inliers=inliers, used=used, support=support, residual=residual, hessian=hessian)


def polish_on_features(
    features: FeatureRows, reference: FeatureRows, T_ref_start: NDArray[np.float64], iterations: int = 8
) -> tuple[NDArray[np.float64], int]:
    """Least squares over the coinciding features, each weighed by both covariances (ICE without points).

    Args:
        features: features of the new scan.
        reference: features of the local map.
        T_ref_start: (3,) start.
        iterations: most Gauss-Newton steps.

    Returns:
        (3,) the pose, and the number of coincidences there.
    """
    pose = np.empty(3)
    hit = hypothesis_kernels.polish_on_features(
        features.kinds, features.rows, reference.kinds, reference.rows, T_ref_start, iterations, pose
    )
    return pose, hit
