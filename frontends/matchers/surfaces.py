"""Which directions a scan can say nothing about, told by the way its surfaces face."""

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _surface_kernels as kernels
from graph.dense import eigh


def weak_directions(points: NDArray[np.float64], link: float, least: float) -> NDArray[np.float64]:
    """Directions of the tangent space along which hardly any surface faces: those of a corridor, or of a round room.

    Matching scores cannot tell: along a corridor they peak where the same stretch of wall is seen, whatever the motion.

    Args:
        points: (n, 2) returns of a scan in the robot frame, in beam order [m].
        link: neighbouring returns nearer than this lie on one surface [m].
        least: a direction is weak if the squared cosines between it and the normals are less than this on average;
            rotations count as displacements at the mean distance of the points.

    Returns:
        (k, 3) unit vectors, order x, y, θ.
    """
    mean, reach = kernels.facing(points, link)
    eigenvalues, axes = eigh(mean)
    weak = axes[:, eigenvalues < least].T / np.array([1.0, 1.0, reach])
    return np.asarray(weak / np.sqrt((weak * weak).sum(axis=1, keepdims=True)))
