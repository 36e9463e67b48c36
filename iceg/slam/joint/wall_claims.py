"""How much better than the graph the walls may know where the key poses are, and that they know it no worse.

The walls' covariances take it for certain which points lie on one wall. That was looked for within some centimetres
of where the graph put the poses. Where the graph knows them far worse, as after a long way among people, or along
corridors with few beams, points lie on the wrong piece of wall, the refinement cannot leave its place, and the claim is
void. The graph's own covariances are too large where all is well (their standard deviations are up to 3.6 times those
of the walls in nine of ten recorded worlds) but hold where logs go wrong.

Points far from the laser tell nothing in the walls' covariances, nor do matches. On open ground hardly anything stands
near, and odometry would be left alone: 20 m claimed on a campus of 1.6 km that is known to 3 cm. The graph has the
matches; what it knows better it knows.
"""

import numpy as np
from numpy.typing import NDArray

from graph import dense

CREDIBLE = 4.5
"""Where most of the walls' standard deviations would be so many times smaller than the graph's, something is wrong with
the walls. With 3, good runs are told that their walls do not confirm them; with 9, two wrong ones are told nothing."""


def believed_covariances(
    walls: NDArray[np.float64], graph: NDArray[np.float64], gain: float
) -> NDArray[np.float64] | None:
    """The walls' covariances, nowhere far smaller than the graph's, nor larger.

    Args:
        walls: (k, 3, 3) marginals of the key poses from the points on shared walls, relative to the first …
        graph: … and from the factors of the graph.
        gain: the walls' standard deviation counts as no more than so many times smaller, in any direction.

    Returns:
        (k, 3, 3), or None where more than half of the positions would be known too well: nothing is believed then.
    """
    variances, least = (c[1:, 0, 0] + c[1:, 1, 1] for c in (walls, graph / CREDIBLE**2))
    if np.count_nonzero(variances < least) > 0.5 * len(least):
        return None
    believed = walls.copy()
    try:
        root = dense.cholesky(graph[1:])
    except np.linalg.LinAlgError:  # rounding has spoilt them: they judge nothing
        return believed
    whitened = dense.solve(root, np.swapaxes(dense.solve(root, walls[1:]), 1, 2))
    shares, axes = dense.eigh(whitened)
    directions = dense.matmul(root, axes)
    lacking = np.clip(shares, 1.0 / gain**2, 1.0) - shares
    believed[1:] += dense.matmul(directions * lacking[:, None, :], np.swapaxes(directions, 1, 2))
    return believed
