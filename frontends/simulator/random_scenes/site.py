"""A building site: where the plans put walls and furniture."""

import math
from dataclasses import dataclass, field

import numpy as np

from frontends.simulator import world as shapes
from frontends.simulator.world import Segments, World

DOOR = 0.95
"""Width of a door opening unless a plan says otherwise [m]."""
OUTER_WALL = 0.3
"""Thickness of the outer walls of a building [m]."""
_LEAF = 0.85  # m
_LEAST_WALL = 0.05  # m: a shorter piece beside a door is left out


@dataclass
class Site:
    """What stands so far.

    Attributes:
        rng: what is random about it.
        standing: all that the laser can hit.
        solid: (n, 4) segments each [m] of inner parts no beam gets to, which no route may use.
    """

    rng: np.random.Generator
    standing: list[World] = field(default_factory=list)
    solid: list[Segments] = field(default_factory=list)

    @property
    def world(self) -> World:
        """All that stands."""
        return World.joined(self.standing)

    def put(self, segments: Segments, *, start: float = -math.inf, end: float = math.inf, glass: float = 0.0) -> None:
        """Add (n, 4) segments [m] that stand from `start` to `end` [s]; `glass` is the share of beams that pass."""
        self.standing.append(World.empty().with_segments(segments, start=start, end=end, glass=glass))

    def wall(self, x0: float, y0: float, x1: float, y1: float, *, thickness: float = 0.0, glass: float = 0.0) -> None:
        """A wall from one point to another [m], centred on their line; thin without a thickness [m]."""
        if math.hypot(x1 - x0, y1 - y0) < 1e-6:
            return
        ends = [(x0, y0), (x1, y1)]
        self.put(shapes.thick_wall(ends, thickness) if thickness else shapes.polyline(ends), glass=glass)

    def room(self, x0: float, y0: float, x1: float, y1: float, *, thickness: float = OUTER_WALL) -> None:
        """Four walls around the rectangle between two corners [m]."""
        self.wall(x0, y0, x1, y0, thickness=thickness)
        self.wall(x0, y1, x1, y1, thickness=thickness)
        self.wall(x0, y0, x0, y1, thickness=thickness)
        self.wall(x1, y0, x1, y1, thickness=thickness)

    def wall_with_doors(
        self,
        x0: float,
        y0: float,
        x1: float,
        y1: float,
        doors: list[float],
        *,
        width: float = DOOR,
        glass: float = 0.0,
    ) -> None:
        """A wall with door openings, some of them with the leaf of a door that stands open.

        Args:
            x0: first end [m].
            y0: first end [m].
            x1: other end [m].
            y1: other end [m].
            doors: centres of the openings, from the first end along the wall [m]; those without room are left out.
            width: of an opening [m].
            glass: share of the slanting beams that pass through the wall.
        """
        length = math.hypot(x1 - x0, y1 - y0)
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        done = 0.0
        for door in sorted(doors):
            left, right = door - width / 2, door + width / 2
            if left <= done + _LEAST_WALL or right >= length - _LEAST_WALL:
                continue
            hinge_x, hinge_y = x0 + ux * left, y0 + uy * left
            self.wall(x0 + ux * done, y0 + uy * done, hinge_x, hinge_y, thickness=0.12, glass=glass)
            if self.rng.random() < 0.4:
                self._leaf(hinge_x, hinge_y, math.atan2(uy, ux))
            done = right
        self.wall(x0 + ux * done, y0 + uy * done, x1, y1, thickness=0.12, glass=glass)

    def box(
        self,
        x: float,
        y: float,
        width: float,
        depth: float,
        turn: float = 0.0,
        *,
        start: float = -math.inf,
        end: float = math.inf,
    ) -> None:
        """A cupboard, crate or pillar around a centre [m], its width turned by [rad]; stands from start to end [s]."""
        self.put(shapes.rectangle(x, y, width, depth, turn), start=start, end=end)

    def column(self, x: float, y: float, radius: float, pieces: int = 8) -> None:
        """A round column or trunk around a centre [m]."""
        self.put(shapes.arc(x, y, radius, pieces=pieces))

    def furnish(self, x0: float, y0: float, x1: float, y1: float, n: int) -> None:
        """Put n pieces of furniture into the room between two corners [m], none where there is no room."""
        if min(x1 - x0, y1 - y0) < 1.6:
            return
        for _ in range(n):
            [self._along_x, self._along_y, self._table, self._plant][self.rng.integers(4)](x0, y0, x1, y1)

    def _leaf(self, x: float, y: float, wall: float) -> None:
        """The leaf of a door, ajar from its wall's heading [rad]."""
        side = 1.0 if self.rng.random() < 0.5 else -1.0
        heading = wall + side * self.rng.uniform(0.9, 1.9)
        self.wall(x, y, x + _LEAF * math.cos(heading), y + _LEAF * math.sin(heading))

    def _along_x(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """A cupboard at the lower or upper wall."""
        width = self.rng.uniform(0.5, 1.6)
        has_choice = x1 - x0 > width + 0.4
        x = self.rng.uniform(x0 + width / 2 + 0.1, x1 - width / 2 - 0.1) if has_choice else (x0 + x1) / 2
        self.box(x, y0 + 0.32 if self.rng.random() < 0.5 else y1 - 0.32, min(width, x1 - x0), 0.5)

    def _along_y(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """A cupboard at the left or right wall."""
        width = min(self.rng.uniform(0.5, 1.6), (y1 - y0) / 2)
        x = x0 + 0.32 if self.rng.random() < 0.5 else x1 - 0.32
        self.box(x, self.rng.uniform(y0 + width / 2 + 0.1, y1 - width / 2 - 0.1), 0.5, width)

    def _table(self, x0: float, y0: float, x1: float, y1: float) -> None:
        x, y = self.rng.uniform(x0 + 0.9, x1 - 0.7), self.rng.uniform(y0 + 0.9, y1 - 0.7)
        width, depth = self.rng.uniform(0.6, 1.6), self.rng.uniform(0.5, 0.9)
        self.put(shapes.table(x, y, width, depth, self.rng.uniform(-0.3, 0.3)))

    def _plant(self, x0: float, y0: float, x1: float, y1: float) -> None:
        x, y = self.rng.uniform(x0 + 0.4, x1 - 0.4), self.rng.uniform(y0 + 0.4, y1 - 0.4)
        self.column(x, y, self.rng.uniform(0.08, 0.3))
