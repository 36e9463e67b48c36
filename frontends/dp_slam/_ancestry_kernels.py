"""The ancestry tree, compiled: its order, how it shrinks from one generation to the next, what a particle inherits."""

import math

import numpy as np
from numpy.typing import NDArray

from frontends.dp_slam.shared_maps import Observations, Tree
from graph.compiled import compiled


@compiled
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


@compiled
def prune(kept: NDArray[np.int64], observations: Observations, tree: Tree) -> tuple[int, int]:
    """Nodes without descendants die with their observations; a node with one child takes it in.

    `kept` says how many particles of the next generation descend from each leaf; a leaf that was merged into its parent
    is replaced among the leaves.

    Returns:
        How many nodes died, and how many were merged.
    """
    died, merged = 0, 0
    for particle in range(len(tree.leaves)):
        if kept[particle] == 0:
            died += _die_out(tree.leaves[particle], observations, tree)
    for child in range(len(tree.parents)):
        above = tree.parents[child]
        if tree.children[child] >= 0 and above >= 0 and tree.children[above] == 1:
            _bequeath(child, above, observations)
            _take_place(child, above, tree)
            merged += 1
    return died, merged


@compiled
def _die_out(leaf: int, observations: Observations, tree: Tree) -> int:
    """Remove a leaf and all above it that have no other child; how many these are."""
    heads, _, places, in_cell, back, of_node, firsts, _, pool = observations
    died = 0
    node = leaf
    while node >= 0 and tree.children[node] == 0:
        observation = firsts[node]
        while observation >= 0:
            following = of_node[observation]
            _unlink(observation, heads, places, in_cell, back, pool)
            observation = following
        above = tree.parents[node]
        tree.children[node], tree.parents[node], firsts[node] = -1, -1, -1
        died += 1
        if above >= 0:
            tree.children[above] -= 1
        node = above
    return died


@compiled
def _bequeath(child: int, above: int, observations: Observations) -> None:
    """The observations of an only child become its parent's; where the parent had one it is replaced."""
    heads, owners, places, in_cell, back, of_node, firsts, evidence, pool = observations
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
    firsts[child] = -1


@compiled
def _take_place(child: int, above: int, tree: Tree) -> None:
    """Put a node in the place of its only child."""
    tree.children[above] = tree.children[child]
    for node in range(len(tree.parents)):
        if tree.parents[node] == child:
            tree.parents[node] = above
    for particle in range(len(tree.leaves)):
        if tree.leaves[particle] == child:
            tree.leaves[particle] = above
    tree.children[child], tree.parents[child] = -1, -1


@compiled
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


@compiled
def densities_of(leaf: int, prior_length: float, observations: Observations, tree: Tree) -> NDArray[np.float32]:
    """(cells,) stops per cell length of one particle's map without the path credited in advance, NaN where unknown."""
    height = np.full(len(tree.parents), -1, np.int32)
    node, level = leaf, 0
    while node >= 0:
        height[node] = level
        level += 1
        node = tree.parents[node]
    densities = np.full(len(observations.heads), math.nan, np.float32)
    for cell in range(len(densities)):
        nearest = level
        observation = observations.heads[cell]
        while observation >= 0:
            above = height[observations.owners[observation]]
            if 0 <= above < nearest:
                nearest = above
                path = max(observations.evidence[observation, 1] - prior_length, 1e-3)
                densities[cell] = observations.evidence[observation, 0] / path
            observation = observations.in_cell[observation]
    return densities
