"""Beams through the shared maps of DP-SLAM, compiled: how likely each reading is, and what a scan adds."""

import math

import numpy as np
from numpy.typing import NDArray

from frontends.dp_slam.shared_maps import BeamModel, Beams, Caches, Observations, Tree
from graph.compiled import compiled

_UNSEEN, _EMPTY, _UNKNOWN = -1, -2, -3  # kinds of views: not looked up yet, free for all, unknown to all
Ray = tuple[float, float, float, float, float, float]
"""Where a beam begins, x and y [cells], its unit direction, and the stretch that matters, from and to [cells]."""
_FAR = 12.5  # squared error over twice the variance from which on a stop cannot have caused the reading


@compiled
def localise(
    lasers: NDArray[np.float64],
    particle_of: NDArray[np.int32],
    scan: Beams,
    model: BeamModel,
    shape: tuple[int, int],
    observations: Observations,
    tree: Tree,
    caches: Caches,
    scores: NDArray[np.float64],
) -> int:
    """Log-likelihood of the scan for each sample, −inf for those culled on the way.

    First over a short stretch around each reading, to cull; then those left over the whole beams, culled further. The
    samples are (n, 3) poses of the laser, x, y [cells] and heading [rad], judged by the map of `particle_of`.

    Returns:
        How many samples survived the first evaluation, or −1 when the caches are full; `scores` is filled.
    """
    directions, readings, returned = scan
    view_of, densities = caches.view_of, caches.densities
    alive = np.ones(len(lasers), np.bool_)
    survivors = 0
    for quick in (True, False):
        scores[:] = 0.0
        for first in range(model.passes):
            for sample in range(len(lasers)):
                if not alive[sample]:
                    continue
                x, y, particle = lasers[sample, 0], lasers[sample, 1], particle_of[sample]
                c, s = math.cos(lasers[sample, 2]), math.sin(lasers[sample, 2])
                product = 1.0
                for beam in range(first, len(readings), model.passes):
                    reading, through = readings[beam], not returned[beam]
                    if quick and through:
                        continue
                    begin, end = _stretch(reading, quick, model)
                    ux = c * directions[beam, 0] - s * directions[beam, 1]
                    uy = s * directions[beam, 0] + c * directions[beam, 1]
                    ray = (x, y, ux, uy, begin, end)
                    likelihood = _beam(ray, reading, through, particle, shape, model, view_of, densities)
                    if likelihood < 0.0:
                        if not _see(ray, shape, observations, tree, caches):
                            return -1
                        likelihood = _beam(ray, reading, through, particle, shape, model, view_of, densities)
                    product *= max(likelihood, model.floor)
                    if product < 1e-200:
                        scores[sample] += math.log(product)
                        product = 1.0
                scores[sample] += math.log(product)
            _cull(scores, model.cull, alive)
        if quick:
            survivors = int(alive.sum())
    scores[~alive] = -math.inf
    return survivors


@compiled
def _stretch(reading: float, quick: bool, model: BeamModel) -> tuple[float, float]:
    """Where along a beam its likelihood is evaluated, from and to [cells]."""
    if quick:
        return max(0.0, reading - model.quick_before), reading + model.quick_beyond
    return 0.0, min(reading + model.trace_margin, model.max_range)


@compiled
def _cull(scores: NDArray[np.float64], cull: float, alive: NDArray[np.bool_]) -> None:
    """Give up the samples whose score lies so far below the best one's."""
    best = -math.inf
    for sample in range(len(scores)):
        if alive[sample]:
            best = max(best, scores[sample])
    for sample in range(len(scores)):
        alive[sample] = alive[sample] and scores[sample] >= best - cull


@compiled
def _beam(
    ray: Ray,
    reading: float,
    passes_through: bool,
    particle: int,
    shape: tuple[int, int],
    model: BeamModel,
    view_of: NDArray[np.int32],
    densities: NDArray[np.float32],
) -> float:
    """Likelihood of a reading, Σ P(reach)·P(stop)·exp(−err²/2σ²) along the beam; −1 where a cell is not filled in.

    A reading of an obstacle is normalised by the probability that the beam stops at all on the stretch; one that passed
    through gets what is left of it at the end. Lengths in cells.
    """
    _, _, ux, uy, begin, end = ray
    column, row, next_x, next_y, per_x, per_y = _enter(ray)
    step_x, step_y = (1 if ux > 0.0 else -1), (1 if uy > 0.0 else -1)
    t = begin
    reach, likelihood = 1.0, 0.0
    while t < end:
        leave = min(next_x, next_y, end)
        density = model.prior_density
        if 0 <= row < shape[0] and 0 <= column < shape[1]:
            view = view_of[row * shape[1] + column]
            if view == _UNSEEN:
                return -1.0
            if view == _EMPTY:
                density = 0.0
            elif view >= 0:
                density = densities[view, particle]
                if density < 0.0:
                    density = model.prior_density
        if density > 0.0 and leave > t:
            depth = density * (leave - t)
            stop = reach * (depth * (1.0 - depth * (0.5 - depth / 6.0)) if depth < 0.01 else 1.0 - math.exp(-depth))
            error = 0.5 * (t + leave) - reading
            exponent = error * error / (2.0 * model.range_variance)
            if exponent < _FAR:
                likelihood += stop * math.exp(-exponent)
            reach -= stop
        t = leave
        if next_x < next_y:
            column += step_x
            next_x += per_x
        else:
            row += step_y
            next_y += per_y
    if passes_through:
        return likelihood + reach
    return likelihood / (1.0 - reach) if reach < 1.0 else 0.0


@compiled
def _see(
    ray: Ray,
    shape: tuple[int, int],
    observations: Observations,
    tree: Tree,
    caches: Caches,
) -> bool:
    """Fill in what all particles see along a beam; False when the caches are full."""
    _, _, ux, uy, begin, end = ray
    column, row, next_x, next_y, per_x, per_y = _enter(ray)
    step_x, step_y = (1 if ux > 0.0 else -1), (1 if uy > 0.0 else -1)
    t = begin
    while t < end:
        if 0 <= row < shape[0] and 0 <= column < shape[1]:
            cell = row * shape[1] + column
            if caches.view_of[cell] == _UNSEEN:
                if caches.counts[1] >= len(caches.viewed) or caches.counts[2] >= len(caches.densities):
                    return False
                caches.viewed[caches.counts[1]] = cell
                caches.counts[1] += 1
                caches.view_of[cell] = _look(cell, observations, tree, caches)
        t = min(next_x, next_y)
        if next_x < next_y:
            column += step_x
            next_x += per_x
        else:
            row += step_y
            next_y += per_y
    return True


@compiled
def _look(cell: int, observations: Observations, tree: Tree, caches: Caches) -> int:
    """What all particles see of a cell: a kind of view, or the row of `densities` that was filled."""
    if observations.heads[cell] < 0:
        return _UNKNOWN
    row = caches.row_of[cell]
    if row >= 0 and caches.facts[row, 0] == len(tree.leaves) and caches.facts[row, 1] == 0:
        return _EMPTY
    if _is_free_for_all(cell, observations, tree):
        return _EMPTY
    if row >= 0:
        seen = caches.rows[row]
    else:
        seen = caches.seen
        heads, owners, in_cell = observations.heads, observations.owners, observations.in_cell
        _gather(cell, heads, owners, in_cell, tree.parents, tree.order, tree.leaves, caches.nearest, seen)
    slot = int(caches.counts[2])
    known, stops = 0, False
    for particle in range(len(tree.leaves)):
        observation = seen[particle]
        if observation < 0:
            caches.densities[slot, particle] = -1.0
        else:
            known += 1
            density = observations.evidence[observation, 0] / observations.evidence[observation, 1]
            caches.densities[slot, particle] = density
            stops = stops or density > 0.0
    if known == 0:
        return _UNKNOWN
    if known == len(tree.leaves) and not stops:
        return _EMPTY
    caches.counts[2] += 1
    return slot


@compiled
def _is_free_for_all(cell: int, observations: Observations, tree: Tree) -> bool:
    """Free for the root and for all that changed it since: the most frequent case by far."""
    everywhere = False
    observation = observations.heads[cell]
    while observation >= 0:
        if observations.evidence[observation, 0] > 0.0:
            return False
        everywhere = everywhere or observations.owners[observation] == tree.order[0]
        observation = observations.in_cell[observation]
    return everywhere


@compiled
def _gather(
    cell: int,
    heads: NDArray[np.int32],
    owners: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    parents: NDArray[np.int32],
    order: NDArray[np.int32],
    leaves: NDArray[np.int32],
    nearest: NDArray[np.int32],
    row: NDArray[np.int32],
) -> None:
    """Each particle's observation of a cell, down the tree: one's own, or else the parent's."""
    observation = heads[cell]
    if observation < 0 or (in_cell[observation] < 0 and owners[observation] == order[0]):
        row[: len(leaves)] = observation
        return
    for node in order:
        nearest[node] = -1
    while observation >= 0:
        nearest[owners[observation]] = observation
        observation = in_cell[observation]
    for node in order:
        if nearest[node] < 0 and parents[node] >= 0:
            nearest[node] = nearest[parents[node]]
    for particle in range(len(leaves)):
        row[particle] = nearest[leaves[particle]]


@compiled
def _enter(ray: Ray) -> tuple[int, int, float, float, float, float]:
    """Column and row where a beam begins, where it crosses the next column and row, and how far apart crossings are."""
    x, y, ux, uy, begin, _ = ray
    sx, sy = x + ux * begin, y + uy * begin
    column, row = math.floor(sx), math.floor(sy)
    per_x = 1.0 / abs(ux) if ux != 0.0 else math.inf
    per_y = 1.0 / abs(uy) if uy != 0.0 else math.inf
    next_x, next_y = math.inf, math.inf
    if ux != 0.0:
        next_x = begin + ((column + 1 - sx) if ux > 0.0 else (sx - column)) * per_x
    if uy != 0.0:
        next_y = begin + ((row + 1 - sy) if uy > 0.0 else (sy - row)) * per_y
    return column, row, next_x, next_y, per_x, per_y


@compiled
def add_scan(
    laser: NDArray[np.float64],
    particle: int,
    scan: Beams,
    prior_length: float,
    shape: tuple[int, int],
    observations: Observations,
    tree: Tree,
    caches: Caches,
) -> None:
    """Add a scan to one particle's map: path through every cell up to the reading, and a stop in the last one.

    A cell that the particle's own node has not observed yet gets an observation that continues its ancestor's.
    """
    directions, readings, returned = scan
    # Out of the tuple once: each look-up of an array in it counts references, which costs as much as a cell.
    heads, owners, _, in_cell, _, _, _, evidence, _ = observations
    row_of, rowed, rows, facts, _, _, _, counts, nearest, _ = caches
    parents, _, order, leaves = tree
    node = leaves[particle]
    c, s = math.cos(laser[2]), math.sin(laser[2])
    for beam in range(len(readings)):
        ux = c * directions[beam, 0] - s * directions[beam, 1]
        uy = s * directions[beam, 0] + c * directions[beam, 1]
        end = readings[beam]
        column, row, next_x, next_y, per_x, per_y = _enter((laser[0], laser[1], ux, uy, 0.0, end))
        t = 0.0
        while t < end:
            leave = min(next_x, next_y, end)
            if 0 <= row < shape[0] and 0 <= column < shape[1]:
                cell = row * shape[1] + column
                slot = row_of[cell]
                if slot < 0:
                    slot = counts[0]
                    counts[0] += 1
                    row_of[cell], rowed[slot] = slot, cell
                    _gather(cell, heads, owners, in_cell, parents, order, leaves, nearest, rows[slot])
                    _state(rows[slot, : len(leaves)], evidence, facts[slot])
                seen = rows[slot, particle]
                own = seen
                if seen < 0 or owners[seen] != node:
                    own = _begin(cell, node, seen, prior_length, observations)
                    rows[slot, particle] = own
                    facts[slot, 0] += seen < 0
                evidence[own, 1] += leave - t
                if leave >= end and returned[beam]:
                    evidence[own, 0] += 1.0
                    facts[slot, 1] = 1
            t = leave
            if next_x < next_y:
                column += 1 if ux > 0.0 else -1
                next_x += per_x
            else:
                row += 1 if uy > 0.0 else -1
                next_y += per_y


@compiled
def _begin(cell: int, node: int, inherited: int, prior_length: float, observations: Observations) -> int:
    """Take an observation of a cell out of the pool for a node; it continues the ancestor's, -1 where there is none."""
    heads, owners, places, in_cell, back, of_node, firsts, evidence, pool = observations
    own = pool[0]
    pool[0] = in_cell[own]
    pool[1] -= 1
    owners[own], places[own] = node, cell
    in_cell[own], of_node[own], back[own] = heads[cell], firsts[node], -1
    if heads[cell] >= 0:
        back[heads[cell]] = own
    heads[cell], firsts[node] = own, own
    if inherited >= 0:
        evidence[own, 0], evidence[own, 1] = evidence[inherited, 0], evidence[inherited, 1]
    else:
        evidence[own, 0], evidence[own, 1] = 0.0, prior_length
    return int(own)


@compiled
def _state(row: NDArray[np.int32], evidence: NDArray[np.float32], facts: NDArray[np.int32]) -> None:
    """How many particles know a cell, and whether any of them has seen a beam stop in it."""
    facts[0], facts[1] = 0, 0
    last = -1
    for observation in row:
        if observation < 0:
            continue
        facts[0] += 1
        if observation != last:
            last = observation
            if evidence[observation, 0] > 0.0:
                facts[1] = 1


@compiled
def forget(caches: Caches) -> None:
    """Empty the caches of a generation."""
    for k in range(caches.counts[0]):
        caches.row_of[caches.rowed[k]] = -1
    for k in range(caches.counts[1]):
        caches.view_of[caches.viewed[k]] = _UNSEEN
    caches.counts[:] = 0
