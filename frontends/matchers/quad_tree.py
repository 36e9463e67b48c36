"""A quad tree of points in the plane, for nearest neighbours."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _quad_tree_kernels as kernels
from frontends.matchers._quad_tree_kernels import Nodes


@dataclass(frozen=True, slots=True, kw_only=True)
class QuadTree:
    """Points with the tree over them.

    Attributes:
        xy: (n, 2) [m].
        nodes: the tree.
    """

    xy: NDArray[np.float64]
    nodes: Nodes

    @classmethod
    def of(cls, xy: NDArray[np.float64]) -> "QuadTree":
        """The tree over (n, 2) points."""
        return cls(xy=xy, nodes=kernels.build_tree(xy))

    def nearest(
        self, queries: NDArray[np.float64], max_distance: float = math.inf
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Nearest point of each query.

        Args:
            queries: (k, 2) [m].
            max_distance: farthest neighbour [m].

        Returns:
            (k,) index, -1 where no point is nearer than `max_distance`, and (k,) distance [m].
        """
        indices, squares = kernels.nearest_all(queries, self.xy, self.nodes, max_distance**2)
        return indices, np.sqrt(squares)
