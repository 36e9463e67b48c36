"""A 2D world of wall segments, each with the time in which it stands and what it does to a beam."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graph.elementary import cos_sin
from graph.errors import IcegError
from graph.limits import LIMITS
from graph.se2 import transform_points

Segments = NDArray[np.float64]
"""(n, 4) wall segments x0, y0, x1, y1 [m] in the world frame."""


_FARTHEST_WALL = 2.0 * LIMITS.coordinate
"""A piece of furniture reaches beyond the place it is put at [m]."""


class SimulatorError(IcegError):
    """A world, a route or a setting that cannot be simulated."""


@dataclass(frozen=True, kw_only=True)
class World:
    """Everything the laser can hit.

    Attributes:
        segments: (n, 4) x0, y0, x1, y1 [m].
        visible_from: (n,) time from which a segment stands [s], -inf for ever before.
        visible_to: (n,) time at which it is taken away [s], +inf for never.
        glass: (n,) share of the slanting beams that pass through it; None: nothing is of glass.
        dark: (n,) share of the beams that it swallows; None: nothing is dark.
    """

    segments: Segments
    visible_from: NDArray[np.float64]
    visible_to: NDArray[np.float64]
    glass: NDArray[np.float64] | None = None
    dark: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        n = len(self.segments)
        if self.segments.shape != (n, 4) or not (np.abs(self.segments) <= _FARTHEST_WALL).all():
            raise SimulatorError(
                f"a world needs (n, 4) finite segments within {_FARTHEST_WALL:g} m of its origin, found shape "
                f"{self.segments.shape}"
            )
        if self.visible_from.shape != (n,) or self.visible_to.shape != (n,):
            raise SimulatorError(
                f"{n} segments need as many times, found {self.visible_from.shape} and {self.visible_to.shape}"
            )
        for name, share in (("glass", self.glass), ("dark", self.dark)):
            if share is not None and (share.shape != (n,) or not ((share >= 0) & (share <= 1)).all()):
                raise SimulatorError(f"{n} segments need as many shares of '{name}' in [0, 1], found {share}")

    @classmethod
    def empty(cls) -> "World":
        """A world without anything in it."""
        return cls(segments=np.zeros((0, 4)), visible_from=np.zeros(0), visible_to=np.zeros(0))

    def with_segments(
        self, segments: Segments, *, start: float = -np.inf, end: float = np.inf, glass: float = 0.0, dark: float = 0.0
    ) -> "World":
        """This world and some more segments.

        Args:
            segments: (m, 4) what to add.
            start: time from which they stand [s].
            end: time at which they are taken away [s].
            glass: share of the slanting beams that pass through them.
            dark: share of the beams that they swallow.

        Returns:
            The larger world.
        """
        m = len(segments)
        return self.with_world(
            World(
                segments=segments,
                visible_from=np.full(m, start),
                visible_to=np.full(m, end),
                glass=np.full(m, glass) if glass else None,
                dark=np.full(m, dark) if dark else None,
            )
        )

    def with_world(self, other: "World") -> "World":
        """This world and all that stands in another one."""
        return World.joined([self, other])

    @classmethod
    def joined(cls, worlds: Sequence["World"]) -> "World":
        """All that stands in any of these worlds, in their order."""
        worlds = worlds or [cls.empty()]
        return cls(
            segments=np.concatenate([world.segments for world in worlds]),
            visible_from=np.concatenate([world.visible_from for world in worlds]),
            visible_to=np.concatenate([world.visible_to for world in worlds]),
            glass=_joined([(len(world.segments), world.glass) for world in worlds]),
            dark=_joined([(len(world.segments), world.dark) for world in worlds]),
        )

    def without_glass(self) -> "World":
        """What a beam sees that passes through every pane; segments keep their places, panes never stand."""
        if self.glass is None:
            return self
        return replace(self, visible_from=np.where(self.glass > 0, np.inf, self.visible_from))

    def at(self, time: float) -> Segments:
        """The segments that stand at `time` [s]."""
        return self.segments[(self.visible_from <= time) & (time < self.visible_to)]

    def clearance(self, points: ArrayLike, time: float = 0.0) -> NDArray[np.float64]:
        """Distance from each point to the nearest segment that stands.

        Args:
            points: (n, 2) world frame [m].
            time: when [s].

        Returns:
            (n,) [m]; inf in an empty world.
        """
        p = np.asarray(points, dtype=np.float64).reshape(-1, 1, 2)
        segments = self.at(time)
        start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
        length2 = np.maximum(np.sum(along**2, axis=1), 1e-18)
        share = np.clip(np.sum((p - start) * along, axis=2) / length2, 0.0, 1.0)
        offsets = p - (start + share[..., None] * along)
        distances = np.hypot(offsets[..., 0], offsets[..., 1])
        nearest: NDArray[np.float64] = distances.min(axis=1, initial=np.inf)
        return nearest


def _joined(shares: Sequence[tuple[int, NDArray[np.float64] | None]]) -> NDArray[np.float64] | None:
    """The shares of several worlds of so many segments, 0 where one has none; None where none of them has any."""
    if all(share is None for _, share in shares):
        return None
    return np.concatenate([np.zeros(n) if share is None else share for n, share in shares])


def polyline(points: ArrayLike) -> Segments:
    """Thin walls from point to point.

    Args:
        points: (n, 2) [m], n ≥ 2.

    Returns:
        (n - 1, 4) segments.
    """
    p = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    return np.concatenate([p[:-1], p[1:]], axis=1)


def thick_wall(points: ArrayLike, thickness: float) -> Segments:
    """Walls with two faces and two ends, centred on a polyline; at a bend they overlap and close the corner.

    Args:
        points: (n, 2) centre line [m], n ≥ 2.
        thickness: from face to face [m].

    Returns:
        (4 (n - 1), 4) segments.
    """
    pieces = []
    legs = polyline(points)
    for index, (x0, y0, x1, y1) in enumerate(legs):
        length = float(np.hypot(x1 - x0, y1 - y0))
        turn = math.atan2(y1 - y0, x1 - x0)
        before = thickness / 2 if index > 0 else 0.0
        after = thickness / 2 if index < len(legs) - 1 else 0.0
        middle = (after - before) / 2
        centre_x = (x0 + x1) / 2 + middle * math.cos(turn)
        centre_y = (y0 + y1) / 2 + middle * math.sin(turn)
        pieces.append(rectangle(centre_x, centre_y, length + before + after, thickness, turn))
    return np.concatenate(pieces)


def rectangle(x: float, y: float, width: float, depth: float, turn: float = 0.0) -> Segments:
    """A cupboard, a crate, a pillar.

    Args:
        x: centre [m].
        y: centre [m].
        width: size along its own x axis [m].
        depth: size along its own y axis [m].
        turn: heading of its x axis [rad].

    Returns:
        (4, 4) segments.
    """
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * (width / 2, depth / 2)
    return polyline(_placed(corners, x, y, turn))


def arc(x: float, y: float, radius: float, start: float = 0.0, end: float = 2 * np.pi, pieces: int = 16) -> Segments:
    """A round wall or column as short straight pieces.

    Args:
        x: centre [m].
        y: centre [m].
        radius: [m].
        start: bearing of the first point from the centre [rad].
        end: bearing of the last point [rad].
        pieces: number of segments.

    Returns:
        (pieces, 4) segments.
    """
    bearings = np.linspace(start, end, pieces + 1)
    return polyline(np.array([x, y]) + radius * np.stack(cos_sin(bearings), axis=1))


def table(x: float, y: float, width: float, depth: float, turn: float = 0.0, leg: float = 0.06) -> Segments:
    """A table or chair as a laser below its top sees it: four square legs.

    Args:
        x: centre [m].
        y: centre [m].
        width: outer size along its own x axis [m].
        depth: outer size along its own y axis [m].
        turn: heading of its x axis [rad].
        leg: side of a leg [m].

    Returns:
        (16, 4) segments.
    """
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * ((width - leg) / 2, (depth - leg) / 2)
    return np.concatenate([rectangle(cx, cy, leg, leg, turn) for cx, cy in _placed(corners, x, y, turn)])


def _placed(points: NDArray[np.float64], x: float, y: float, turn: float) -> NDArray[np.float64]:
    return transform_points(np.array([x, y, turn]), points)
