"""What the particles of DP-SLAM share: one grid of observations, and the ancestry tree that says whose they are.

A cell of the grid holds a list of observations, at most one per node of the ancestry tree; a particle's view of a cell
is the observation of its nearest ancestor (itself included) that has one there. Where indices stand, −1 is none.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Observations(NamedTuple):
    """What was seen in each cell, as linked lists by cell and by node."""

    heads: NDArray[np.int32]
    """(cells,) first observation of each cell."""
    owners: NDArray[np.int32]
    """(capacity,) node that made an observation."""
    places: NDArray[np.int32]
    """(capacity,) its cell."""
    in_cell: NDArray[np.int32]
    """(capacity,) next observation of the same cell, or next free one."""
    back: NDArray[np.int32]
    """(capacity,) the one before it in its cell."""
    of_node: NDArray[np.int32]
    """(capacity,) next observation of the same node."""
    firsts: NDArray[np.int32]
    """(nodes,) first observation of each node."""
    evidence: NDArray[np.float32]
    """(capacity, 2) stops, and path through the cell [cells]."""
    pool: NDArray[np.int32]
    """(2,) first free observation, number of free ones."""


class Tree(NamedTuple):
    """The ancestry tree of the particles."""

    parents: NDArray[np.int32]
    """(nodes,) parent of each node."""
    children: NDArray[np.int32]
    """(nodes,) number of its children; −1 marks a node that is not in use."""
    order: NDArray[np.int32]
    """(used,) nodes in use, parents before children."""
    leaves: NDArray[np.int32]
    """(particles,) node of each particle."""


class Caches(NamedTuple):
    """Looked up once in a generation, valid as long as the tree does not change.

    A cell has a row when the observation of every particle in it is known, and a view when it is known what all of them
    see there: `_beam_kernels` has the kinds of views.
    """

    row_of: NDArray[np.int32]
    """(cells,) row of each cell."""
    rowed: NDArray[np.int32]
    """(rows,) its cell."""
    rows: NDArray[np.int32]
    """(rows, particles) each particle's observation of it."""
    facts: NDArray[np.int32]
    """(rows, 2) how many particles know the cell, whether any of them has seen a stop in it."""
    view_of: NDArray[np.int32]
    """(cells,) what all particles see of each cell: a kind of view, or a row of `densities`."""
    viewed: NDArray[np.int32]
    """(views,) the cells with a view."""
    densities: NDArray[np.float32]
    """(views, particles) stops per cell length; −1 for particles that do not know the cell."""
    counts: NDArray[np.int64]
    """(3,) rows, views, and rows of `densities` in use."""
    nearest: NDArray[np.int32]
    """(nodes,) working space: each node's observation of one cell."""
    seen: NDArray[np.int32]
    """(particles,) working space: each particle's."""


class Beams(NamedTuple):
    """A scan, by beams."""

    directions: NDArray[np.float64]
    """(n, 2) unit vectors at the laser."""
    readings: NDArray[np.float64]
    """(n,) [cells], cut at the greatest range."""
    returned: NDArray[np.bool_]
    """(n,) whether each met an obstacle."""


class BeamModel(NamedTuple):
    """How readings come about and how samples are culled; lengths in cells, meanings as in `DpSlamConfig`."""

    prior_density: float
    range_variance: float
    floor: float
    quick_before: float
    quick_beyond: float
    trace_margin: float
    max_range: float
    passes: int
    cull: float
