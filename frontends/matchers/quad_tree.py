"""A quad tree of points in the plane, for nearest neighbours."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _weighted_kernels as kernels


class Nodes(NamedTuple):
    """The tree in the layout of the kernels.

    Attributes:
        boxes: (m, 3) centre x, y and half width of each node's square [m].
        children: (m, 4) int32 node of each quadrant, -1 where it is empty.
        leaves: (m, 2) int32 first place in `order` and number of points; 0 points for an inner node.
        order: (n,) int32 the points, leaf by leaf.
    """

    boxes: NDArray[np.float64]
    children: NDArray[np.int32]
    leaves: NDArray[np.int32]
    order: NDArray[np.int32]


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
        return cls(xy=xy, nodes=Nodes(*kernels.build_tree(xy)))

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
        indices, squares = kernels.nearest_all(queries, self.xy, *self.nodes, max_distance**2)
        return indices, np.sqrt(squares)
