"""The ancestry tree, compiled: its order, how it shrinks from one generation to the next, what a particle inherits.

Layouts are those of `_beam_kernels`.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def tree_order(parents: NDArray[np.int32], children: NDArray[np.int32]) -> NDArray[np.int32]:
    """Nodes in use, parents before children."""
    depth = np.zeros(len(parents), np.int32)
    used = 0
    for node in range(len(parents)):
        if children[node] < 0:
            continue
        used += 1
        above = parents[node]
        while above >= 0:
            depth[node] += 1
            above = parents[above]
    order = np.empty(used, np.int32)
    n = 0
    level = 0
    while n < used:
        for node in range(len(parents)):
            if children[node] >= 0 and depth[node] == level:
                order[n] = node
                n += 1
        level += 1
    return order


@njit(cache=True)
def prune(
    leaves: NDArray[np.int32],
    kept: NDArray[np.int64],
    heads: NDArray[np.int32],
    owners: NDArray[np.int32],
    places: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    back: NDArray[np.int32],
    of_node: NDArray[np.int32],
    evidence: NDArray[np.float32],
    pool: NDArray[np.int32],
    parents: NDArray[np.int32],
    children: NDArray[np.int32],
    firsts: NDArray[np.int32],
) -> tuple[int, int]:
    """Nodes without descendants die with their observations; a node with one child takes it in.

    `kept` says how many particles of the next generation descend from each leaf; a leaf that was merged into its parent
    is replaced in `leaves`.

    Returns:
        How many nodes died, and how many were merged.
    """
    died, merged = 0, 0
    for particle in range(len(leaves)):
        if kept[particle] == 0:
            died += _die_out(leaves[particle], heads, places, in_cell, back, of_node, pool, parents, children, firsts)
    for child in range(len(parents)):
        above = parents[child]
        if children[child] >= 0 and above >= 0 and children[above] == 1:
            _bequeath(child, above, heads, owners, places, in_cell, back, of_node, evidence, pool, firsts)
            _take_place(child, above, leaves, parents, children, firsts)
            merged += 1
    return died, merged


@njit(cache=True)
def _die_out(
    leaf: int,
    heads: NDArray[np.int32],
    places: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    back: NDArray[np.int32],
    of_node: NDArray[np.int32],
    pool: NDArray[np.int32],
    parents: NDArray[np.int32],
    children: NDArray[np.int32],
    firsts: NDArray[np.int32],
) -> int:
    """Remove a leaf and all above it that have no other child; how many these are."""
    died = 0
    node = leaf
    while node >= 0 and children[node] == 0:
        observation = firsts[node]
        while observation >= 0:
            following = of_node[observation]
            _unlink(observation, heads, places, in_cell, back, pool)
            observation = following
        above = parents[node]
        children[node], parents[node], firsts[node] = -1, -1, -1
        died += 1
        if above >= 0:
            children[above] -= 1
        node = above
    return died


@njit(cache=True)
def _bequeath(
    child: int,
    above: int,
    heads: NDArray[np.int32],
    owners: NDArray[np.int32],
    places: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    back: NDArray[np.int32],
    of_node: NDArray[np.int32],
    evidence: NDArray[np.float32],
    pool: NDArray[np.int32],
    firsts: NDArray[np.int32],
) -> None:
    """The observations of an only child become its parent's; where the parent had one it is replaced."""
    observation = firsts[child]
    while observation >= 0:
        following = of_node[observation]
        older = heads[places[observation]]
        while older >= 0 and owners[older] != above:
            older = in_cell[older]
        if older >= 0:
            evidence[older, 0], evidence[older, 1] = evidence[observation, 0], evidence[observation, 1]
            _unlink(observation, heads, places, in_cell, back, pool)
        else:
            owners[observation] = above
            of_node[observation] = firsts[above]
            firsts[above] = observation
        observation = following


@njit(cache=True)
def _take_place(
    child: int,
    above: int,
    leaves: NDArray[np.int32],
    parents: NDArray[np.int32],
    children: NDArray[np.int32],
    firsts: NDArray[np.int32],
) -> None:
    """Put a node in the place of its only child."""
    children[above] = children[child]
    for node in range(len(parents)):
        if parents[node] == child:
            parents[node] = above
    for particle in range(len(leaves)):
        if leaves[particle] == child:
            leaves[particle] = above
    children[child], parents[child], firsts[child] = -1, -1, -1


@njit(cache=True)
def _unlink(
    observation: int,
    heads: NDArray[np.int32],
    places: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    back: NDArray[np.int32],
    pool: NDArray[np.int32],
) -> None:
    """Take an observation out of its cell and back to the free ones."""
    before, behind = back[observation], in_cell[observation]
    if before >= 0:
        in_cell[before] = behind
    else:
        heads[places[observation]] = behind
    if behind >= 0:
        back[behind] = before
    in_cell[observation] = pool[0]
    pool[0] = observation
    pool[1] += 1


@njit(cache=True)
def densities_of(
    leaf: int,
    prior_length: float,
    heads: NDArray[np.int32],
    owners: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    evidence: NDArray[np.float32],
    parents: NDArray[np.int32],
    densities: NDArray[np.float32],
) -> None:
    """Stops per cell length of one particle's map without the path credited in advance, NaN where it is unknown."""
    height = np.full(len(parents), -1, np.int32)
    node, level = leaf, 0
    while node >= 0:
        height[node] = level
        level += 1
        node = parents[node]
    for cell in range(len(heads)):
        densities[cell] = math.nan
        nearest = level
        observation = heads[cell]
        while observation >= 0:
            above = height[owners[observation]]
            if 0 <= above < nearest:
                nearest = above
                densities[cell] = evidence[observation, 0] / max(evidence[observation, 1] - prior_length, 1e-3)
            observation = in_cell[observation]
