"""Straight walls out of many short pieces: each grows from its best piece along its line."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.dense import matmul
from iceg.floor_plan.config import FloorPlanConfig
from iceg.slam.joint.wall_pieces import WallPieces

_SHORT = 0.15
"""The direction of shorter pieces is little known [m]."""
_ROUNDS = 12
_AROUND, _TURNING = 0.3, 0.15
"""Pieces farther from the line of the first than this [m], and this share of the way along it, never join it."""
_GAUSS = 1.0 / math.sqrt(3.0)
"""Two points so far from the middle, in half lengths, have the moments of a whole segment."""


class Line(NamedTuple):
    """A line through (2,) `middle` along the unit vector (2,) `along`."""

    middle: NDArray[np.float64]
    along: NDArray[np.float64]

    def coordinates(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How far (..., 2) points lie along the line, and to its left [m]."""
        x, y = points[..., 0] - self.middle[0], points[..., 1] - self.middle[1]
        return x * self.along[0] + y * self.along[1], y * self.along[0] - x * self.along[1]

    def points(self, along: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 2) the points that lie (...) along the line."""
        return self.middle + along[..., None] * self.along


@dataclass(frozen=True, slots=True, kw_only=True)
class StraightWall:
    """One straight wall.

    Attributes:
        ends: (2, 2) [m]; the side that was seen lies to the left.
        points: that lie on it.
        deviation: their root mean square distance from it [m].
        key_poses: from how many it was seen, on average along it.
    """

    ends: NDArray[np.float64]
    points: int
    deviation: float
    key_poses: float

    @property
    def length(self) -> float:
        """[m]."""
        return math.dist(self.ends[0], self.ends[1])

    @property
    def line(self) -> Line:
        """The line that it is part of."""
        return Line(self.ends.mean(axis=0), (self.ends[1] - self.ends[0]) / self.length)


def straight_walls(pieces: WallPieces, config: FloorPlanConfig) -> list[StraightWall]:
    """Put pieces together that lie on one line, face the same way and leave no gap.

    Args:
        pieces: of wall.
        config: what is one line, and a gap.

    Returns:
        The walls, those with most points and length first.
    """
    lengths = np.hypot(*(pieces.ends[:, 1] - pieces.ends[:, 0]).T)
    order = np.argsort(-lengths * pieces.points, kind="stable")
    free = lengths > 0.0
    walls = []
    for seed in order:
        if not free[seed] or lengths[seed] < _SHORT:
            continue
        members = _grown(int(seed), pieces, lengths, free, config)
        free[members] = False
        walls.append(_wall(members, pieces, lengths))
    return walls


def united(walls: list[StraightWall], config: FloorPlanConfig) -> list[StraightWall]:
    """The same walls, those with two faces too near to each other drawn as one line.

    Args:
        walls: straight walls, the strongest first.
        config: how near that is.
    """
    kept: list[StraightWall] = []
    middles, halves = np.empty((len(walls), 2)), np.empty(len(walls))
    for wall in walls:
        middle, half, n = wall.ends.mean(axis=0), 0.5 * wall.length, len(kept)
        apart = np.hypot(*(middles[:n] - middle).T) - halves[:n]
        near = np.flatnonzero(apart < half + config.thinnest).tolist()
        place = next((i for i in near if _is_other_face(wall, kept[i], config)), n)
        if place == n:
            kept.append(wall)
        else:
            kept[place] = _with_face(kept[place], wall)
        middles[place], halves[place] = kept[place].ends.mean(axis=0), 0.5 * kept[place].length
    return kept


def _grown(
    seed: int, pieces: WallPieces, lengths: NDArray[np.float64], free: NDArray[np.bool_], config: FloorPlanConfig
) -> NDArray[np.int64]:
    """The pieces of the wall that a piece is part of."""
    near = _near_line_of(seed, pieces, lengths, free, config)
    ends, long, own = pieces.ends[near], lengths[near], int(np.searchsorted(near, seed))
    limits = np.where(long < _SHORT, math.cos(2.0 * config.turned), math.cos(config.turned))
    members = np.array([own])
    for _ in range(_ROUNDS):
        along, off = _fitted(near[members], pieces).coordinates(ends)
        fits = np.abs(off).max(axis=1) < config.off_line
        fits &= along[:, 1] - along[:, 0] >= limits * long
        fits[own] = True
        found = _without_gap(own, np.flatnonzero(fits), along, config.gap)
        if np.array_equal(found, members):
            break
        members = found
    grown: NDArray[np.int64] = near[members]
    return grown


def _near_line_of(
    seed: int, pieces: WallPieces, lengths: NDArray[np.float64], free: NDArray[np.bool_], config: FloorPlanConfig
) -> NDArray[np.int64]:
    """Pieces near enough to the line of one to lie on the line that it will be part of; its direction may turn."""
    along, off = _fitted(np.array([seed]), pieces).coordinates(pieces.ends)
    reach = _AROUND + _TURNING * np.abs(along).max(axis=1)
    faces = along[:, 1] - along[:, 0] > math.cos(3.0 * config.turned) * lengths
    near = free & faces & (np.abs(off).max(axis=1) < reach)
    near[seed] = True
    return np.flatnonzero(near)


def _without_gap(seed: int, chosen: NDArray[np.int64], along: NDArray[np.float64], gap: float) -> NDArray[np.int64]:
    """Of the chosen pieces those that hang together with one of them, in their order."""
    low, high = along[chosen].min(axis=1), along[chosen].max(axis=1)
    order = np.argsort(low, kind="stable")
    reached = np.maximum.accumulate(high[order])
    parts = np.concatenate([[0], np.cumsum(low[order][1:] > reached[:-1] + gap)])
    of_seed = parts[np.flatnonzero(chosen[order] == seed)[0]]
    return np.sort(chosen[order][parts == of_seed])


def _fitted(members: NDArray[np.int64], pieces: WallPieces) -> Line:
    """Total least squares through the pieces, each counting by its points, in the direction of the pieces."""
    ends, weights = pieces.ends[members], pieces.points[members].astype(np.float64)
    middles, halves = ends.mean(axis=1), 0.5 * _GAUSS * (ends[:, 1] - ends[:, 0])
    middle = (weights[:, None] * middles).sum(axis=0) / weights.sum()
    spread = np.concatenate([middles + halves, middles - halves]) - middle
    twice = np.concatenate([weights, weights])[:, None]
    (xx, xy), (_, yy) = matmul((twice * spread).T, spread)
    heading = 0.5 * math.atan2(2.0 * xy, xx - yy)
    along = np.array([math.cos(heading), math.sin(heading)])
    forwards = (weights[:, None] * (ends[:, 1] - ends[:, 0])).sum(axis=0)
    return Line(middle, along if float((along * forwards).sum()) >= 0.0 else -along)


def _wall(members: NDArray[np.int64], pieces: WallPieces, lengths: NDArray[np.float64]) -> StraightWall:
    line = _fitted(members, pieces)
    along, off = line.coordinates(pieces.ends[members])
    points, long = pieces.points[members], lengths[members]
    squares = pieces.deviations[members] ** 2 + off.mean(axis=1) ** 2
    return StraightWall(
        ends=line.points(np.array([along.min(), along.max()])),
        points=int(points.sum()),
        deviation=math.sqrt(float((points * squares).sum()) / float(points.sum())),
        key_poses=float((long * pieces.key_poses[members]).sum() / long.sum()),
    )


def _is_other_face(wall: StraightWall, other: StraightWall, config: FloorPlanConfig) -> bool:
    """Whether two walls are the faces of one that is thinner than is drawn, and overlap by half of the shorter one."""
    along, off = other.line.coordinates(wall.ends)
    half = 0.5 * other.length
    overlap = min(float(along.max()), half) - max(float(along.min()), -half)
    return bool(np.abs(off).max() < config.thinnest and overlap > 0.5 * min(wall.length, other.length))


def _with_face(wall: StraightWall, face: StraightWall) -> StraightWall:
    """One wall out of two faces, on the line between them, by their points."""
    line, total = wall.line, wall.points + face.points
    along, off = line.coordinates(face.ends)
    half, share = 0.5 * wall.length, face.points / total
    shift = share * float(off.mean()) * np.array([-line.along[1], line.along[0]])
    reach = np.array([min(float(along.min()), -half), max(float(along.max()), half)])
    return StraightWall(
        ends=line.points(reach) + shift,
        points=total,
        deviation=math.sqrt((1.0 - share) * wall.deviation**2 + share * face.deviation**2),
        key_poses=wall.key_poses + face.key_poses,
    )
