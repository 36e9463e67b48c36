"""What is believed of the key poses between what the graph and what the walls say.

The joint refinement starts at the graph's optimum and goes towards that of the points on walls, often not all of the
way: along a corridor where little holds, or after a long way among people, points lie on the wrong piece of wall and
pull back far less than their normal equations say. A pose that went the share a of the way errs by a times what the
walls err by plus 1 - a times what the graph errs by. Both rest on the same scans, so how their errors hang together is
unknown; whatever it is, the covariance of the sum is at most a Σ_walls + (1 - a) Σ_graph.

Points far from the laser tell nothing in the walls' covariances, nor do matches. On open ground hardly anything stands
near, and odometry would be left alone: 20 m claimed on a campus of 1.6 km that is known to 3 cm. The graph has the
matches; what it knows better it knows.
"""

import numpy as np
from numpy.typing import NDArray

from graph import dense
from iceg.slam.joint_config import JointRefinementConfig


def believed_covariances(
    walls: NDArray[np.float64], graph: NDArray[np.float64], share: float, config: JointRefinementConfig
) -> NDArray[np.float64] | None:
    """Of poses between the graph's optimum and that of the walls, in no direction larger than the graph's.

    Args:
        walls: (k, 3, 3) marginals of the key poses from the points on shared walls, relative to the first …
        graph: … and from the factors of the graph.
        share: of the way to the walls' optimum that the poses went, 0 to 1.
        config: how much the walls may claim.

    Returns:
        (k, 3, 3), or None where the walls are not believed.
    """
    variances, least = (c[1:, 0, 0] + c[1:, 1, 1] for c in (walls, graph / config.credible_ratio**2))
    if share < config.confirmed_share and np.count_nonzero(variances < least) > 0.5 * len(least):
        return None
    believed = walls.copy()
    try:
        root = dense.cholesky(graph[1:])
    except np.linalg.LinAlgError:  # rounding has spoilt them: they judge nothing
        return believed
    whitened = dense.solve(root, np.swapaxes(dense.solve(root, walls[1:]), 1, 2))
    ratios, axes = dense.eigh(whitened)
    directions = dense.matmul(root, axes)
    lacking = share * np.minimum(ratios, 1.0) + (1.0 - share) - ratios
    believed[1:] += dense.matmul(directions * lacking[:, None, :], np.swapaxes(directions, 1, 2))
    return believed
