"""A quad tree of points in the plane, compiled."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both

_BUCKET = 6
"""A node of more points than this is split …"""
_MAX_DEPTH = 24
"""… down to here: equal points cannot be told apart."""


class Nodes(NamedTuple):
    """A tree over n points; node 0 is the root.

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


@compiled
def build_tree(xy: NDArray[np.float64]) -> Nodes:
    """Divide the points' square into four until a node holds few of them."""
    n = len(xy)
    order = np.arange(n).astype(np.int32)
    capacity = 16 + 4 * n
    boxes = np.empty((capacity, 3))
    children, leaves = np.full((capacity, 4), -1, np.int32), np.zeros((capacity, 2), np.int32)
    if n == 0:
        boxes[0] = 0.0
        return Nodes(boxes[:1], children[:1], leaves[:1], order)
    x_min, x_max, y_min, y_max = xy[:, 0].min(), xy[:, 0].max(), xy[:, 1].min(), xy[:, 1].max()
    boxes[0, 0], boxes[0, 1] = 0.5 * (x_min + x_max), 0.5 * (y_min + y_max)
    boxes[0, 2] = 0.5 * max(x_max - x_min, y_max - y_min) + 1e-9
    leaves[0, 1] = n
    depth = np.zeros(capacity, np.int32)
    sorted_, quadrant = np.empty(n, np.int32), np.empty(n, np.int32)
    node, count = 0, 1
    while node < count:
        first, size = leaves[node]
        if size > _BUCKET and depth[node] < _MAX_DEPTH and count + 4 <= capacity:
            leaves[node, 1] = 0
            cx, cy, half = boxes[node]
            for k in range(first, first + size):
                quadrant[k] = (xy[order[k], 0] >= cx) + 2 * (xy[order[k], 1] >= cy)
            place_in = first
            for q in range(4):
                begin = place_in
                for k in range(first, first + size):
                    if quadrant[k] == q:
                        sorted_[place_in] = order[k]
                        place_in += 1
                if place_in > begin:
                    children[node, q] = count
                    boxes[count, 0] = cx + (0.5 if q % 2 == 1 else -0.5) * half
                    boxes[count, 1] = cy + (0.5 if q >= 2 else -0.5) * half
                    boxes[count, 2] = 0.5 * half
                    leaves[count, 0], leaves[count, 1] = begin, place_in - begin
                    depth[count] = depth[node] + 1
                    count += 1
            for k in range(first, first + size):
                order[k] = sorted_[k]
        node += 1
    return Nodes(boxes[:count].copy(), children[:count].copy(), leaves[:count].copy(), order)


@compiled_for_both
def nearest(
    x: float, y: float, xy: NDArray[np.float64], nodes: Nodes, stack: NDArray[np.int32], limit2: float, hint: int
) -> tuple[int, float]:
    """Nearest point of a quad tree and its squared distance, index -1 if none is nearer than √limit2.

    The hint, a point that may be near or -1, bounds the search; `stack` is room for 128 nodes.
    """
    boxes, children, leaves, order = nodes
    best, best2 = -1, limit2
    if hint >= 0:
        d2 = (xy[hint, 0] - x) ** 2 + (xy[hint, 1] - y) ** 2
        if d2 < best2:
            best, best2 = hint, d2
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        dx = max(0.0, abs(x - boxes[node, 0]) - boxes[node, 2])
        dy = max(0.0, abs(y - boxes[node, 1]) - boxes[node, 2])
        if dx * dx + dy * dy >= best2:
            continue
        first, size = leaves[node]
        for k in range(first, first + size):
            j = order[k]
            d2 = (xy[j, 0] - x) ** 2 + (xy[j, 1] - y) ** 2
            if d2 < best2:
                best, best2 = j, d2
        own = (x >= boxes[node, 0]) + 2 * (y >= boxes[node, 1])
        for q in (3, 2, 1):  # the quadrant of the query last, so that it is searched first
            child = children[node, own ^ q]
            if child >= 0:
                stack[top] = child
                top += 1
        child = children[node, own]
        if child >= 0:
            stack[top] = child
            top += 1
    return best, best2


@compiled
def nearest_all(
    queries: NDArray[np.float64], xy: NDArray[np.float64], nodes: Nodes, limit2: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """`nearest` of many queries."""
    found, squares = np.empty(len(queries), np.int64), np.empty(len(queries))
    stack = np.empty(128, np.int32)
    for i in range(len(queries)):
        found[i], squares[i] = nearest(queries[i, 0], queries[i, 1], xy, nodes, stack, limit2, -1)
    return found, squares
