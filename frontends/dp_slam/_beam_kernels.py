"""Beams through the shared maps of DP-SLAM, compiled: how likely each reading is, and what a scan adds.

Maps. All particles share one grid. A cell holds a list of observations, at most one per node of the ancestry tree; a
particle's view of a cell is the observation of its nearest ancestor (itself included) that has one there.

Layouts, all indices int32, −1 for none:
    heads     (cells,)        first observation of each cell
    owners    (capacity,)     node that made an observation
    places    (capacity,)     its cell
    in_cell   (capacity,)     next observation of the same cell, or next free one
    back      (capacity,)     the one before it in its cell
    of_node   (capacity,)     next observation of the same node
    evidence  (capacity, 2)   float32: stops, and path through the cell [cells]
    pool      (2,)            first free observation, number of free ones
    parents, children, firsts (nodes,)   parent, number of children and first observation of each node;
                              children −1 marks a node that is not in use

Caches of one generation, valid as long as the tree does not change:
    row_of    (cells,)        row of `rows` that holds each particle's observation of a cell, and of `facts`: how many
                              particles know the cell, whether any of them has seen a stop in it
    view_of   (cells,)        what all particles see: `_UNSEEN`, `_EMPTY`, `_UNKNOWN` or a row of `densities`
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_UNSEEN, _EMPTY, _UNKNOWN = -1, -2, -3
_FAR = 12.5  # squared error over twice the variance from which on a stop cannot have caused the reading


@njit(cache=True)
def _gather(
    cell: int,
    heads: NDArray[np.int32],
    owners: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    parents: NDArray[np.int32],
    order: NDArray[np.int32],
    leaves: NDArray[np.int32],
    scratch: NDArray[np.int32],
    row: NDArray[np.int32],
) -> None:
    """Each particle's observation of a cell, down the tree: one's own, or else the parent's."""
    observation = heads[cell]
    if observation < 0 or (in_cell[observation] < 0 and owners[observation] == order[0]):
        row[: len(leaves)] = observation
        return
    for node in order:
        scratch[node] = -1
    while observation >= 0:
        scratch[owners[observation]] = observation
        observation = in_cell[observation]
    for node in order:
        if scratch[node] < 0 and parents[node] >= 0:
            scratch[node] = scratch[parents[node]]
    for particle in range(len(leaves)):
        row[particle] = scratch[leaves[particle]]


@njit(cache=True)
def _look(
    cell: int,
    heads: NDArray[np.int32],
    owners: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    evidence: NDArray[np.float32],
    parents: NDArray[np.int32],
    order: NDArray[np.int32],
    leaves: NDArray[np.int32],
    scratch: NDArray[np.int32],
    row_of: NDArray[np.int32],
    rows: NDArray[np.int32],
    facts: NDArray[np.int32],
    view_of: NDArray[np.int32],
    viewed: NDArray[np.int32],
    densities: NDArray[np.float32],
    counts: NDArray[np.int64],
) -> None:
    """Fill in what all particles see of a cell."""
    viewed[counts[1]] = cell
    counts[1] += 1
    if heads[cell] < 0:
        view_of[cell] = _UNKNOWN
        return
    if row_of[cell] >= 0 and facts[row_of[cell], 0] == len(leaves) and facts[row_of[cell], 1] == 0:
        view_of[cell] = _EMPTY
        return
    # Free for the root and for all that changed it since: free for everyone, the most frequent case by far.
    everywhere, stops = False, False
    observation = heads[cell]
    while observation >= 0 and not stops:
        everywhere = everywhere or owners[observation] == order[0]
        stops = evidence[observation, 0] > 0.0
        observation = in_cell[observation]
    if everywhere and not stops:
        view_of[cell] = _EMPTY
        return
    n = len(leaves)
    known, stops = 0, False
    slot = counts[2]
    if row_of[cell] >= 0:
        row = rows[row_of[cell]]
    else:
        row = scratch[len(scratch) - n :]
        _gather(cell, heads, owners, in_cell, parents, order, leaves, scratch, row)
    for particle in range(n):
        observation = row[particle]
        if observation < 0:
            densities[slot, particle] = -1.0
        else:
            known += 1
            density = evidence[observation, 0] / evidence[observation, 1]
            densities[slot, particle] = density
            stops = stops or density > 0.0
    if known == n and not stops:
        view = _EMPTY
    elif known == 0:
        view = _UNKNOWN
    else:
        view = slot
        counts[2] += 1
    view_of[cell] = view


@njit(cache=True)
def _see(
    x: float,
    y: float,
    ux: float,
    uy: float,
    begin: float,
    end: float,
    shape: tuple[int, int],
    heads: NDArray[np.int32],
    owners: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    evidence: NDArray[np.float32],
    parents: NDArray[np.int32],
    order: NDArray[np.int32],
    leaves: NDArray[np.int32],
    scratch: NDArray[np.int32],
    row_of: NDArray[np.int32],
    rows: NDArray[np.int32],
    facts: NDArray[np.int32],
    view_of: NDArray[np.int32],
    viewed: NDArray[np.int32],
    densities: NDArray[np.float32],
    counts: NDArray[np.int64],
) -> bool:
    """Fill in what all particles see along a beam; False when the caches are full."""
    column, row, next_x, next_y, per_x, per_y = _enter(x, y, ux, uy, begin)
    step_x, step_y = (1 if ux > 0.0 else -1), (1 if uy > 0.0 else -1)
    t = begin
    while t < end:
        if 0 <= row < shape[0] and 0 <= column < shape[1]:
            cell = row * shape[1] + column
            if view_of[cell] == _UNSEEN:
                if counts[1] >= len(viewed) or counts[2] >= len(densities):
                    return False
                _look(
                    cell,
                    heads,
                    owners,
                    in_cell,
                    evidence,
                    parents,
                    order,
                    leaves,
                    scratch,
                    row_of,
                    rows,
                    facts,
                    view_of,
                    viewed,
                    densities,
                    counts,
                )
        t = min(next_x, next_y)
        if next_x < next_y:
            column += step_x
            next_x += per_x
        else:
            row += step_y
            next_y += per_y
    return True


@njit(cache=True)
def _enter(x: float, y: float, ux: float, uy: float, begin: float) -> tuple[int, int, float, float, float, float]:
    """Column and row where a beam begins, where it crosses the next column and row, and how far apart crossings are."""
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


@njit(cache=True)
def _beam(
    x: float,
    y: float,
    ux: float,
    uy: float,
    begin: float,
    end: float,
    reading: float,
    passes_through: bool,
    particle: int,
    shape: tuple[int, int],
    prior: float,
    variance: float,
    view_of: NDArray[np.int32],
    densities: NDArray[np.float32],
) -> float:
    """Likelihood of a reading, Σ P(reach)·P(stop)·exp(−err²/2σ²) along the beam; −1 where a cell is not filled in.

    A reading of an obstacle is normalised by the probability that the beam stops at all on the stretch; one that passed
    through gets what is left of it at the end. Lengths in cells.
    """
    column, row, next_x, next_y, per_x, per_y = _enter(x, y, ux, uy, begin)
    step_x, step_y = (1 if ux > 0.0 else -1), (1 if uy > 0.0 else -1)
    t = begin
    reach, likelihood = 1.0, 0.0
    while t < end:
        leave = min(next_x, next_y, end)
        density = prior
        if 0 <= row < shape[0] and 0 <= column < shape[1]:
            view = view_of[row * shape[1] + column]
            if view == _UNSEEN:
                return -1.0
            if view == _EMPTY:
                density = 0.0
            elif view >= 0:
                density = densities[view, particle]
                if density < 0.0:
                    density = prior
        if density > 0.0 and leave > t:
            depth = density * (leave - t)
            stop = reach * (depth * (1.0 - depth * (0.5 - depth / 6.0)) if depth < 0.01 else 1.0 - math.exp(-depth))
            error = 0.5 * (t + leave) - reading
            exponent = error * error / (2.0 * variance)
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


@njit(cache=True)
def localise(
    lasers: NDArray[np.float64],
    particle_of: NDArray[np.int32],
    directions: NDArray[np.float64],
    readings: NDArray[np.float64],
    returned: NDArray[np.bool_],
    passes: int,
    cull: float,
    floor: float,
    before: float,
    beyond: float,
    margin: float,
    max_range: float,
    shape: tuple[int, int],
    prior: float,
    variance: float,
    heads: NDArray[np.int32],
    owners: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    evidence: NDArray[np.float32],
    parents: NDArray[np.int32],
    order: NDArray[np.int32],
    leaves: NDArray[np.int32],
    scratch: NDArray[np.int32],
    row_of: NDArray[np.int32],
    rows: NDArray[np.int32],
    facts: NDArray[np.int32],
    view_of: NDArray[np.int32],
    viewed: NDArray[np.int32],
    densities: NDArray[np.float32],
    counts: NDArray[np.int64],
    log_likelihoods: NDArray[np.float64],
) -> int:
    """Log-likelihood of the scan for each sample, −inf for those culled on the way.

    First over a short stretch around each reading, to cull; then those left over the whole beams, culled further. The
    samples are (n, 3) poses of the laser, x, y [cells] and heading [rad], judged by the map of `particle_of`; the beams
    are unit vectors at the laser with their readings [cells], at most `max_range`, and whether they `returned`.

    Returns:
        How many samples survived the first evaluation, or −1 when the caches are full; `log_likelihoods` is filled.
    """
    n, n_beams = len(lasers), len(readings)
    alive = np.ones(n, np.bool_)
    survivors = 0
    for evaluation in range(2):
        log_likelihoods[:] = 0.0
        for first in range(passes):
            best = -math.inf
            for sample in range(n):
                if not alive[sample]:
                    continue
                c, s = math.cos(lasers[sample, 2]), math.sin(lasers[sample, 2])
                product = 1.0
                for beam in range(first, n_beams, passes):
                    if evaluation == 0 and not returned[beam]:
                        continue
                    reading = readings[beam]
                    if evaluation == 0:
                        begin, end = max(0.0, reading - before), reading + beyond
                    else:
                        begin, end = 0.0, min(reading + margin, max_range)
                    ux = c * directions[beam, 0] - s * directions[beam, 1]
                    uy = s * directions[beam, 0] + c * directions[beam, 1]
                    x, y = lasers[sample, 0], lasers[sample, 1]
                    through = not returned[beam]
                    particle = particle_of[sample]
                    likelihood = _beam(
                        x, y, ux, uy, begin, end, reading, through, particle, shape, prior, variance, view_of, densities
                    )
                    if likelihood < 0.0:
                        filled = _see(
                            x,
                            y,
                            ux,
                            uy,
                            begin,
                            end,
                            shape,
                            heads,
                            owners,
                            in_cell,
                            evidence,
                            parents,
                            order,
                            leaves,
                            scratch,
                            row_of,
                            rows,
                            facts,
                            view_of,
                            viewed,
                            densities,
                            counts,
                        )
                        if not filled:
                            return -1
                        likelihood = _beam(
                            x,
                            y,
                            ux,
                            uy,
                            begin,
                            end,
                            reading,
                            through,
                            particle,
                            shape,
                            prior,
                            variance,
                            view_of,
                            densities,
                        )
                    product *= max(likelihood, floor)
                    if product < 1e-200:
                        log_likelihoods[sample] += math.log(product)
                        product = 1.0
                log_likelihoods[sample] += math.log(product)
                best = max(best, log_likelihoods[sample])
            for sample in range(n):
                if alive[sample] and log_likelihoods[sample] < best - cull:
                    alive[sample] = False
        if evaluation == 0:
            survivors = int(alive.sum())
    for sample in range(n):
        if not alive[sample]:
            log_likelihoods[sample] = -math.inf
    return survivors


@njit(cache=True)
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


@njit(cache=True)
def add_scan(
    laser: NDArray[np.float64],
    particle: int,
    directions: NDArray[np.float64],
    readings: NDArray[np.float64],
    returned: NDArray[np.bool_],
    shape: tuple[int, int],
    prior_length: float,
    heads: NDArray[np.int32],
    owners: NDArray[np.int32],
    places: NDArray[np.int32],
    in_cell: NDArray[np.int32],
    back: NDArray[np.int32],
    of_node: NDArray[np.int32],
    evidence: NDArray[np.float32],
    pool: NDArray[np.int32],
    parents: NDArray[np.int32],
    firsts: NDArray[np.int32],
    order: NDArray[np.int32],
    leaves: NDArray[np.int32],
    scratch: NDArray[np.int32],
    row_of: NDArray[np.int32],
    rowed: NDArray[np.int32],
    rows: NDArray[np.int32],
    facts: NDArray[np.int32],
    counts: NDArray[np.int64],
) -> None:
    """Add a scan to one particle's map: path through every cell up to the reading, and a stop in the last one.

    A cell that the particle's own node has not observed yet gets an observation that continues its ancestor's.
    """
    node = leaves[particle]
    c, s = math.cos(laser[2]), math.sin(laser[2])
    for beam in range(len(readings)):
        ux = c * directions[beam, 0] - s * directions[beam, 1]
        uy = s * directions[beam, 0] + c * directions[beam, 1]
        end = readings[beam]
        column, row, next_x, next_y, per_x, per_y = _enter(laser[0], laser[1], ux, uy, 0.0)
        step_x, step_y = (1 if ux > 0.0 else -1), (1 if uy > 0.0 else -1)
        t = 0.0
        while t < end:
            leave = min(next_x, next_y, end)
            if 0 <= row < shape[0] and 0 <= column < shape[1]:
                cell = row * shape[1] + column
                slot = row_of[cell]
                if slot < 0:
                    slot = counts[0]
                    counts[0] += 1
                    row_of[cell] = slot
                    rowed[slot] = cell
                    _gather(cell, heads, owners, in_cell, parents, order, leaves, scratch, rows[slot])
                    _state(rows[slot, : len(leaves)], evidence, facts[slot])
                observation = rows[slot, particle]
                if observation < 0 or owners[observation] != node:
                    fresh = pool[0]
                    pool[0] = in_cell[fresh]
                    pool[1] -= 1
                    if observation >= 0:
                        evidence[fresh, 0], evidence[fresh, 1] = evidence[observation, 0], evidence[observation, 1]
                    else:
                        evidence[fresh, 0], evidence[fresh, 1] = 0.0, prior_length
                        facts[slot, 0] += 1
                    owners[fresh], places[fresh] = node, cell
                    in_cell[fresh], of_node[fresh] = heads[cell], firsts[node]
                    back[fresh] = -1
                    if heads[cell] >= 0:
                        back[heads[cell]] = fresh
                    heads[cell], firsts[node] = fresh, fresh
                    rows[slot, particle] = fresh
                    observation = fresh
                evidence[observation, 1] += leave - t
                if leave >= end and returned[beam]:
                    evidence[observation, 0] += 1.0
                    facts[slot, 1] = 1
            t = leave
            if next_x < next_y:
                column += step_x
                next_x += per_x
            else:
                row += step_y
                next_y += per_y


@njit(cache=True)
def forget(
    counts: NDArray[np.int64],
    row_of: NDArray[np.int32],
    rowed: NDArray[np.int32],
    view_of: NDArray[np.int32],
    viewed: NDArray[np.int32],
) -> None:
    """Empty the caches of a generation."""
    for k in range(counts[0]):
        row_of[rowed[k]] = -1
    for k in range(counts[1]):
        view_of[viewed[k]] = _UNSEEN
    counts[:] = 0
