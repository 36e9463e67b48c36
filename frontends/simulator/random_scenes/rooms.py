"""Buildings of rooms: offices and schools along corridors, and houses."""

from itertools import pairwise

import numpy as np

from frontends.simulator.random_scenes.site import Site


def office(site: Site) -> None:
    """Corridors with rooms of all widths on both sides, the walls to the corridor sometimes of glass."""
    _rows_of_rooms(site, alike=False)


def school(site: Site) -> None:
    """Corridors with rooms of the same width, most of them furnished the same."""
    _rows_of_rooms(site, alike=True)


def house(site: Site) -> None:
    """A rectangle split again and again into furnished rooms."""
    width, depth = site.rng.uniform(8.0, 16.0), site.rng.uniform(7.0, 13.0)
    site.room(0.0, 0.0, width, depth)
    _split(site, 0.0, 0.0, width, depth, splits=4)


def _rows_of_rooms(site: Site, *, alike: bool) -> None:
    rng = site.rng
    room_width, room_depth, corridor = rng.uniform(3.0, 5.0), rng.uniform(3.5, 6.0), rng.uniform(1.6, 2.8)
    length = int(rng.integers(4, 8)) * room_width
    n_corridors = int(rng.integers(1, 4))
    pitch = 2 * room_depth + corridor
    margin = corridor if n_corridors > 1 or rng.random() < 0.5 else 0.0  # at both ends, it joins the corridors
    glass = 0.6 if rng.random() < 0.3 else 0.0
    site.room(0.0, 0.0, length, n_corridors * pitch)
    for k in range(n_corridors):
        for door_wall, back in (
            (k * pitch + room_depth, k * pitch),
            (k * pitch + room_depth + corridor, (k + 1) * pitch),
        ):
            partitions = _partitions(site, margin, length - margin, room_width, alike=alike)
            _row(site, partitions, door_wall, back, glass, alike=alike)


def _partitions(site: Site, start: float, end: float, width: float, *, alike: bool) -> list[float]:
    """Where the walls between the rooms of a row stand [m], the first at `start`, the last at `end`."""
    most = int((end - start) / width) + 1
    widths = np.full(most, width) if alike else width * site.rng.uniform(0.7, 1.5, most)
    between = (start + np.concatenate([[0.0], np.cumsum(widths)])).tolist()
    return [x for x in between if x < end - 1.5] + [end]


def _row(site: Site, partitions: list[float], door_wall: float, back: float, glass: float, *, alike: bool) -> None:
    """Rooms from the wall with their doors to the wall at their back, both along x."""
    rng = site.rng
    aside = 0.0 if alike else 0.5
    doors = [(x0 + x1) / 2 - partitions[0] + rng.uniform(-aside, aside) for x0, x1 in pairwise(partitions)]
    site.wall_with_doors(partitions[0], door_wall, partitions[-1], door_wall, doors, glass=glass)
    y0, y1 = min(door_wall, back), max(door_wall, back)
    for x in partitions:
        site.wall(x, y0, x, y1, thickness=0.12)
    for x0, x1 in pairwise(partitions):
        if alike and rng.random() < 0.7:
            site.box(x0 + 0.5, (y0 + y1) / 2, 0.5, 1.2)
        else:
            site.furnish(x0 + 0.1, y0 + 0.2, x1 - 0.1, y1 - 0.2, int(rng.integers(4)))


def _split(site: Site, x0: float, y0: float, x1: float, y1: float, splits: int) -> None:
    """Divide a room by a wall with a door or two, and its parts again; furnish what is not divided."""
    rng = site.rng
    width, depth = x1 - x0, y1 - y0
    if splits == 0 or max(width, depth) < 4.5 or (splits < 3 and rng.random() < 0.15):
        site.furnish(x0 + 0.1, y0 + 0.1, x1 - 0.1, y1 - 0.1, int(rng.integers(1, 6)))
    elif width > depth:
        x = x0 + rng.uniform(0.38, 0.62) * width
        site.wall_with_doors(x, y0, x, y1, _doors(site, depth), width=rng.uniform(0.8, 1.2))
        _split(site, x0, y0, x, y1, splits - 1)
        _split(site, x, y0, x1, y1, splits - 1)
    else:
        y = y0 + rng.uniform(0.38, 0.62) * depth
        site.wall_with_doors(x0, y, x1, y, _doors(site, width), width=rng.uniform(0.8, 1.2))
        _split(site, x0, y0, x1, y, splits - 1)
        _split(site, x0, y, x1, y1, splits - 1)


def _doors(site: Site, length: float) -> list[float]:
    """One door somewhere in a wall of some length [m], and sometimes another in a long one."""
    door = site.rng.uniform(0.7, length - 0.7)
    if length > 5.0 and site.rng.random() < 0.6:
        return [door, (door + length / 2) % (length - 1.4) + 0.7]
    return [door]
