"""The correlation score around a match as a surface over its two translations: what its covariance was read from."""

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from graph.elementary import exp
from iceg.ice import _score_grid_kernels as kernels
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.ice.scored import Scored


def correlation_surface(
    matcher: IceMatcher,
    reference: LocalMap,
    scan: Scan,
    T_ref_cur: NDArray[np.float64],
    half_width: float,
    half_cells: int = 20,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Score poses shifted forwards and sideways from a match, the heading kept.

    Args:
        matcher: says how the points are extracted and how wide the score is.
        reference: the local map.
        scan: the scan.
        T_ref_cur: (3,) the match, at the centre of the surface.
        half_width: farthest shift [m].
        half_cells: shifts on either side of the centre.

    Returns:
        (2·half_cells + 1,) shifts [m], and (n, n) scores in [0, 1], row = shift along the robot's y, column = along its
        x, the axes of the covariance. A score is the geometric mean over the points of 1 / (1 + r²/s²), r the distance
        of a point to the line of the nearest surfel, s the width of the refinement.
    """
    scan_points = matcher.observe(scan).points
    n, side, step = len(scan_points), 2 * half_cells + 1, half_width / half_cells
    costs = np.empty((side, side, 1))
    scored = Scored.of(scan_points, reference, matcher.config.refinement)
    kernels.score_grid(scored, n, T_ref_cur, np.eye(3), np.array([step, step, 0.0]), costs)
    return np.linspace(-half_width, half_width, side), exp(-costs[:, :, 0].T / n)
