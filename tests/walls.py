"""Walls that a test can see by heart: a ray caster in NumPy, apart from the simulator's, and a room and a corridor."""

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.se2 import compose

GEOMETRY = ScanGeometry(
    bearings=np.radians(np.arange(-90.0, 91.0)),
    range_min=0.05,
    range_max=20.0,
    T_robot_laser=np.array([0.16, 0.0, 0.0]),
)
ROOM = np.array(
    [[-3, -2, 5, -2], [5, -2, 5, 4], [5, 4, 1, 4], [1, 4, 1, 3], [1, 3, -3, 3], [-3, 3, -3, -2], [2, 0, 2.6, 0.4]],
    float,
)
CORRIDOR = np.array([[-40, -1, 40, -1], [-40, 1, 40, 1]], float)


def see(walls: NDArray[np.float64], T_world_robot: NDArray[np.float64], seed: int = 0, noise: float = 0.008) -> Scan:
    """A scan of walls, (n, 4) x y x y, by a laser of 181 beams."""
    ranges = distances(walls, compose(T_world_robot, GEOMETRY.T_robot_laser), GEOMETRY.bearings)
    ranges += noise * np.random.default_rng(seed).standard_normal(len(ranges))
    return Scan(ranges=np.where(ranges < 20.0, ranges, np.nan).astype(np.float32), geometry=GEOMETRY)


def distances(
    walls: NDArray[np.float64], T_world_laser: NDArray[np.float64], bearings: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance of the nearest wall along each beam [m], infinite without one."""
    x, y, heading = T_world_laser
    ux, uy = np.cos(heading + bearings), np.sin(heading + bearings)
    ranges = np.full(len(bearings), np.inf)
    for ax, ay, bx, by in walls:
        ex, ey = bx - ax, by - ay
        determinant = ux * ey - uy * ex
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((ax - x) * ey - (ay - y) * ex) / determinant
            u = ((ax - x) * uy - (ay - y) * ux) / determinant
        hit = (t > 0) & (u >= 0) & (u <= 1)
        ranges[hit] = np.minimum(ranges[hit], t[hit])
    return ranges
