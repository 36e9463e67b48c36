"""How good a floor plan is where the true walls are known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.elementary import cos_sin
from graph.se2 import transform_points

_SAMPLES = 0.05
"""Walls are compared at places so far apart [m]."""
_SEEN_WITHIN, _SEEN_BY = 0.05, 5
"""A place was seen if so many beams end so near to it [m]."""
_FOUND_WITHIN = 0.05
"""A place is found if a wall of the plan is so near [m] …"""
_SPURIOUS_BEYOND = 0.1
"""… and a place of the plan is spurious if no true wall is [m]."""
_CHUNK = 2_000


@dataclass(frozen=True, slots=True, kw_only=True)
class FloorPlanErrors:
    """A floor plan against the true walls.

    Attributes:
        seen: length of the true walls that the laser saw [m].
        found: share of it that has a wall of the plan within 5 cm.
        drawn: length of the plan's walls [m].
        spurious: length of these that is farther than 10 cm from any true wall [m].
        mean_error: mean distance of the rest from the true walls [m].
        largest_error: which 95 of 100 places of the rest do not exceed [m].
    """

    seen: float
    found: float
    drawn: float
    spurious: float
    mean_error: float
    largest_error: float


def floor_plan_errors(
    walls: NDArray[np.float64], true_walls: NDArray[np.float64], hits: NDArray[np.float64]
) -> FloorPlanErrors:
    """Compare a plan with the truth, both in one frame.

    Args:
        walls: (n, 2, 2) ends of the plan's walls [m].
        true_walls: (m, 2, 2) ends of the true ones [m].
        hits: (k, 2) where beams met the world, which tells what could be seen [m].
    """
    truth, plan = _samples(true_walls), _samples(walls)
    seen = truth[_hits_near(truth, hits) >= _SEEN_BY]
    off = _distances(plan, true_walls)
    near = off[off <= _SPURIOUS_BEYOND]
    return FloorPlanErrors(
        seen=_SAMPLES * len(seen),
        found=float((_distances(seen, walls) <= _FOUND_WITHIN).mean()) if len(seen) else 0.0,
        drawn=_SAMPLES * len(plan),
        spurious=_SAMPLES * (len(plan) - len(near)),
        mean_error=float(near.mean()) if len(near) else 0.0,
        largest_error=float(np.quantile(near, 0.95)) if len(near) else 0.0,
    )


def true_hits(log: Log, truth: NDArray[np.float64], every: int = 5) -> NDArray[np.float64]:
    """(k, 2) where the beams of every so many scans met the world [m].

    Args:
        log: a simulated log.
        truth: (n, 3) T_world_robot of each scan.
        every: so many scans are passed over.
    """
    bearings, T_robot_laser = log.geometry.bearings, log.geometry.T_robot_laser
    cos, sin = cos_sin(np.asarray(bearings, dtype=np.float64))
    hits = []
    for scan in range(0, len(log), every):
        ranges = log.ranges[scan].astype(np.float64)
        met = np.isfinite(ranges)
        p_laser = (ranges[:, None] * np.column_stack([cos, sin]))[met]
        hits.append(transform_points(truth[scan], transform_points(T_robot_laser, p_laser)))
    return np.concatenate(hits)


def _samples(walls: NDArray[np.float64]) -> NDArray[np.float64]:
    """(s, 2) places along walls, evenly spread."""
    places = []
    for first, second in walls:
        n = max(1, round(float(np.hypot(*(second - first))) / _SAMPLES))
        share = ((np.arange(n) + 0.5) / n)[:, None]
        places.append(first + share * (second - first))
    return np.concatenate(places) if places else np.empty((0, 2))


def _distances(points: NDArray[np.float64], walls: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) of each point from the nearest of the walls; infinite without walls."""
    nearest = np.full(len(points), np.inf)
    vectors = walls[:, 1] - walls[:, 0]
    squares = np.maximum((vectors**2).sum(axis=1), 1e-12)
    for start in range(0, len(points), _CHUNK):
        apart = points[start : start + _CHUNK, None] - walls[None, :, 0]
        share = ((apart * vectors).sum(axis=2) / squares).clip(0.0, 1.0)
        off = apart - share[:, :, None] * vectors
        distances = np.hypot(off[:, :, 0], off[:, :, 1])
        nearest[start : start + _CHUNK] = distances.min(axis=1, initial=np.inf)
    return nearest


def _hits_near(points: NDArray[np.float64], hits: NDArray[np.float64]) -> NDArray[np.int64]:
    """(n,) how many beams ended near each point."""
    from scipy.spatial import cKDTree

    near = cKDTree(hits).query_ball_point(points, _SEEN_WITHIN, return_length=True)
    return np.asarray(near, dtype=np.int64)
