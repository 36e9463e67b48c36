"""What is believed of the key poses between what the graph and what the walls say.

The joint refinement starts at the graph's optimum and goes towards that of the points on walls, often not all of the
way: along a corridor where little holds, or after a long way among people, points lie on the wrong piece of wall and
pull back far less than their normal equations say. A pose that went the share a of the way errs by a times what the
walls err by plus 1 - a times what the graph errs by. Both rest on the same scans, so how their errors hang together is
unknown; whatever it is, the covariance of the sum is at most a Σ_walls + (1 - a) Σ_graph.

Points far from the laser tell nothing in the walls' covariances, nor do matches. On open ground hardly anything stands
near, and odometry would be left alone: 20 m claimed on a campus of 1.6 km that is known to 3 cm. The graph has the
matches; what it knows better it knows.

Whether either claims too much, the way between them tells: of two estimates from the same data, the one that knows
less differs from the one that knows more by just what it knows less, Σ_graph - Σ (Hausman, *Specification tests in
econometrics*, 1978). Where the poses went farther, walls and factors contradict each other, and all variances grow.
"""

import numpy as np

from graph import dense
from graph.arrays import Floats
from graph.noise import chi2_gate
from iceg.slam.joint_config import JointRefinementConfig
from iceg.slam.run_warning import RunWarning


def believed_covariances(walls: Floats, graph: Floats, share: float) -> Floats:
    """Of poses between the graph's optimum and that of the walls, in no direction larger than the graph's.

    Args:
        walls: (k, 3, 3) marginals of the key poses from the points on shared walls, relative to the first …
        graph: … and from the factors of the graph.
        share: of the way to the walls' optimum that the poses went, 0 to 1.

    Returns:
        (k, 3, 3).
    """
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


def variance_factor(way: Floats, graph: Floats, believed: Floats, prior: float) -> float:
    """How many times as large as their covariances say the squared way between two estimates is.

    Σ dᵀ Σ_graph⁻¹ d over all poses, against its expectation, the sum of the traces of 1 - Σ_graph⁻¹ Σ.

    Args:
        way: (k, 3) from the graph's optimum to where the poses are, tangent space at each.
        graph: (k, 3, 3) covariances of the former …
        believed: … and of the latter, relative to the first pose, which does not count.
        prior: both sums begin with this share of what they would be if the latter were certain: so little can chance
            do where the two know about as much.

    Returns:
        A factor for all variances; 1 where nothing contradicts them.
    """
    if len(way) < 2:
        return 1.0
    try:
        squared = float((way[1:] * dense.solve(graph[1:], way[1:, :, None])[..., 0]).sum())
    except np.linalg.LinAlgError:
        return 1.0
    left = np.trace(dense.solve(graph[1:], believed[1:]), axis1=1, axis2=2)
    degrees = 3.0 * (len(way) - 1)
    expected = float(np.maximum(3.0 - left, 0.0).sum())
    return max(1.0, (squared + prior * degrees) / (expected + prior * degrees))


def claims_warning(factor: float, config: JointRefinementConfig, *, are_walls_believed: bool) -> RunWarning | None:
    """What a person should know of how sure the poses are said to be, None where nothing speaks against it.

    Args:
        factor: see `variance_factor`.
        config: when to say so.
        are_walls_believed: whether the covariances rest on the walls, too.
    """
    if not are_walls_believed:
        why = "the walls of the map do not confirm it"
    elif factor > chi2_gate(config.contradiction_false_alarm) / 3.0:
        why = f"walls and matches contradict each other, and it allows for {factor**0.5:.1f} times what they claim"
    else:
        return None
    told = f"how sure the poses are (covariances.csv) is itself uncertain: {why}; they may be farther off than it says"
    return RunWarning(kind="covariances", sentence=told)
