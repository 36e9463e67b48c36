"""A route to random goals and back to earlier ones, by shortest paths that like to keep away from walls."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from frontends.simulator.random_scenes.ground import CELL, CLEARANCE, Cells, Ground, Points
from graph.elementary import exp

_NEAR_WALLS = 0.25  # m: over which the dislike of walls fades
_REVISITS = 0.3  # share of the goals that are earlier ones
_RETURNS = 0.6  # share of the routes that end at their start
_STEPS = ((1, 0), (0, 1), (1, 1), (1, -1))
_LONGEST_LEG = 45  # cells that one waypoint may skip
_WINDING = 1.1  # length of a path over its number of cells, as diagonal steps are longer


def plan_route(ground: Ground, length: float, rng: np.random.Generator) -> Points:
    """Waypoints of a route through free cells.

    Args:
        ground: where a robot can be.
        length: of the route, about [m].
        rng: start and goals.

    Returns:
        (n, 2) start and waypoints in the world frame [m], free of walls from each to the next.
    """
    cells = np.argwhere(ground.is_free)
    links = _links(ground, cells)
    start = here = int(rng.integers(len(cells)))
    route, goals = [start], [start]
    travelled = 0.0
    while travelled < 0.9 * length:
        costs, before = dijkstra(links, indices=np.array(here), return_predecessors=True)
        goal = goals[rng.integers(len(goals))] if rng.random() < _REVISITS else int(rng.integers(len(cells)))
        if travelled + costs[goal] * CELL > length and rng.random() < _RETURNS:
            goal = start
        path = _path(before, here, goal)
        travelled += max(len(path), 1) * _WINDING * CELL  # a goal that is here already counts, lest it go on for ever
        route += path
        goals.append(goal)
        here = goal
    return _straightened(ground, ground.centres(cells[route]))


def _links(ground: Ground, cells: Cells) -> csr_array:
    """Symmetric matrix of the costs from each free cell to its neighbours: up to three times as much near walls."""
    numbers = np.full(ground.is_free.shape, -1)
    numbers[ground.is_free] = np.arange(len(cells))
    room = ground.clearance[ground.is_free]
    rows: list[NDArray[np.int64]] = []
    columns: list[NDArray[np.int64]] = []
    costs: list[NDArray[np.float64]] = []
    for step in _STEPS:
        beside = cells + step
        inside = ((beside >= 0) & (beside < numbers.shape)).all(axis=1)
        there = np.full(len(cells), -1)
        there[inside] = numbers[beside[inside, 0], beside[inside, 1]]
        a = np.flatnonzero(there >= 0)
        b = there[a]
        nearest = np.minimum(room[a], room[b])
        cost = math.hypot(*step) * (1.0 + 2.0 * exp(-(nearest - CLEARANCE) / _NEAR_WALLS))
        rows += [a, b]
        columns += [b, a]
        costs += [cost, cost]
    indices = (np.concatenate(rows), np.concatenate(columns))
    return coo_array((np.concatenate(costs), indices), shape=(len(cells), len(cells))).tocsr()


def _path(before: NDArray[np.int32], here: int, goal: int) -> list[int]:
    """Cells from the one after `here` to the goal."""
    path = []
    while goal != here:
        path.append(goal)
        goal = int(before[goal])
    return path[::-1]


def _straightened(ground: Ground, points: Points) -> Points:
    """The fewest of the points, taken greedily, with a free straight way from each to the next."""
    kept, here = [0], 0
    while here < len(points) - 1:
        after = here + 1
        last = min(here + _LONGEST_LEG, len(points) - 1)
        while after < last and ground.is_free_between(points[here], points[after + 1]):
            after += 1
        if not np.array_equal(points[after], points[here]):
            kept.append(after)
        here = after
    return points[kept]
