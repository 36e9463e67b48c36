"""Places that are nearly all passage: mazes, round buildings and rings of corridors."""

import math

import numpy as np
from numpy.typing import NDArray

from frontends.simulator import world as shapes
from frontends.simulator.random_scenes.site import Site

_FILLING = 0.6  # m: distance of the lines that fill what is solid, too near for a robot between them


def maze(site: Site) -> None:
    """A labyrinth on a grid of cells, with some of its walls taken away so that it has loops."""
    rng = site.rng
    n, m, cell = int(rng.integers(4, 8)), int(rng.integers(4, 8)), rng.uniform(1.8, 3.2)
    right, upper = _labyrinth(n, m, rng)
    right &= rng.random((n, m)) > 0.15
    upper &= rng.random((n, m)) > 0.15
    site.room(0.0, 0.0, n * cell, m * cell, thickness=0.15)
    for i, j in np.argwhere(right[:-1]).tolist():
        site.wall((i + 1) * cell, j * cell, (i + 1) * cell, (j + 1) * cell, thickness=0.15)
    for i, j in np.argwhere(upper[:, :-1]).tolist():
        site.wall(i * cell, (j + 1) * cell, (i + 1) * cell, (j + 1) * cell, thickness=0.15)


def round_building(site: Site) -> None:
    """A circular corridor around a solid core, with rooms on its outer side."""
    rng = site.rng
    core, corridor, depth = rng.uniform(7.0, 16.0), rng.uniform(1.8, 3.2), rng.uniform(3.5, 5.5)
    inner, outer = core + corridor, core + corridor + depth
    site.put(shapes.arc(0.0, 0.0, core, pieces=90))
    site.put(shapes.arc(0.0, 0.0, outer, pieces=110))
    site.solid += [shapes.arc(0.0, 0.0, r, pieces=60) for r in np.arange(_FILLING, core - 0.5, _FILLING).tolist()]
    n_rooms = int(rng.integers(7, 14))
    room = 2 * math.pi / n_rooms
    walls = [room * (k + rng.uniform(-0.2, 0.2)) for k in range(n_rooms)]
    for start, end in zip(walls, [*walls[1:], walls[0] + 2 * math.pi], strict=True):
        site.wall(*_polar(inner, start), *_polar(outer, start), thickness=0.1)
        half_door = 0.55 / inner
        door = start + (end - start) * rng.uniform(0.35, 0.65)
        site.put(shapes.arc(0.0, 0.0, inner, start, door - half_door, pieces=6))
        site.put(shapes.arc(0.0, 0.0, inner, door + half_door, end, pieces=6))
        if rng.random() < 0.6:
            site.column(*_polar(inner + 0.7 * depth, (start + end) / 2), rng.uniform(0.2, 0.6))
    for _ in range(int(rng.integers(5))):
        bearing = rng.uniform(0.0, 2 * math.pi)
        site.box(*_polar(core + 0.3, bearing), 0.5, 0.5, bearing)


def corridors(site: Site) -> None:
    """A rectangular ring of corridor around a solid core, with shallow cupboards along its outer side."""
    rng = site.rng
    corridor, length, depth = rng.uniform(1.8, 2.8), rng.uniform(25.0, 50.0), rng.uniform(15.0, 35.0)
    site.room(0.0, 0.0, length, depth, thickness=0.0)
    site.room(corridor, corridor, length - corridor, depth - corridor, thickness=0.0)
    site.solid += [
        shapes.polyline([(corridor, y), (length - corridor, y)])
        for y in np.arange(corridor, depth - corridor, _FILLING).tolist()
    ]
    for _ in range(int(rng.integers(6, 25))):
        side, thickness = int(rng.integers(4)), rng.uniform(0.05, 0.25)
        along = rng.uniform(2.0, (length if side < 2 else depth) - 2.0)
        if side < 2:
            site.box(along, thickness / 2 if side == 0 else depth - thickness / 2, 1.0, thickness)
        else:
            site.box(thickness / 2 if side == 2 else length - thickness / 2, along, thickness, 1.0)


def _labyrinth(n: int, m: int, rng: np.random.Generator) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(n, m) whether a cell has its right wall, and its upper one: a tree of passages, by depth-first search."""
    right, upper = np.ones((n, m), dtype=np.bool_), np.ones((n, m), dtype=np.bool_)
    seen = {(0, 0)}
    path = [(0, 0)]
    while path:
        i, j = path[-1]
        beside = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        unseen = [(k, q) for k, q in beside if 0 <= k < n and 0 <= q < m and (k, q) not in seen]
        if not unseen:
            path.pop()
            continue
        k, q = unseen[rng.integers(len(unseen))]
        if k == i:
            upper[i, min(j, q)] = False
        else:
            right[min(i, k), j] = False
        seen.add((k, q))
        path.append((k, q))
    return right, upper


def _polar(radius: float, bearing: float) -> tuple[float, float]:
    return radius * math.cos(bearing), radius * math.sin(bearing)
