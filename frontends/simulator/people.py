"""People who walk through the world: two legs each, at the height of the laser."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.simulator.world import SimulatorError
from graph.elementary import cos_sin
from graph.limits import LIMITS

LEG_RADIUS = 0.06
"""Of a person [m]."""
_MOST_SPEED = 100.0  # m/s
_STRIDE = 1.4  # m: from a step of one foot to the next step of the same
_REACH = 0.25  # m: how far a foot gets ahead of the body
_HIP = 0.1  # m: from the middle of the body to a leg
_WAITS_AT = 1.0  # m: nearer than this nobody walks towards the robot
_STEPS_ASIDE_AT = 0.75  # m: nearer than this nobody lets the robot come


@dataclass(frozen=True, kw_only=True)
class Person:
    """Somebody on the way.

    Attributes:
        path: (x, y) of two points or more [m]; walked to and fro, or round and round where it ends at its start.
        speed: [m/s].
        appears: when the person comes [s].
        vanishes: when the person leaves [s].
    """

    path: tuple[tuple[float, float], ...]
    speed: float = 1.2
    appears: float = -math.inf
    vanishes: float = math.inf

    def __post_init__(self) -> None:
        if len(set(self.path)) < 2:
            raise SimulatorError(f"a person needs a path of two different points or more, found {self.path}")
        if not all(abs(value) <= LIMITS.coordinate for point in self.path for value in point):
            raise SimulatorError(f"a person walks within {LIMITS.coordinate:g} m of the origin, found another path")
        length = sum(math.dist(a, b) for a, b in zip(self.path, self.path[1:], strict=False))
        if not length > 0:
            raise SimulatorError(f"a person needs a path of some length, found {length} m")
        if not 0 < self.speed <= _MOST_SPEED:
            raise SimulatorError(f"a person's speed must be positive, at most {_MOST_SPEED:g} m/s, found {self.speed}")


def walk(
    people: Sequence[Person], T_world_robot: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where everyone's legs are at each scan.

    People wait rather than walk into the robot, and step aside where it comes at them, so that nobody is run over
    whatever the operator does.

    Args:
        people: who walks.
        T_world_robot: (n, 3) true poses of the robot.
        times: (n,) of the scans [s], increasing.

    Returns:
        (n, 2 len(people), 2) centres of the legs in the world frame [m]; NaN where the person is not there.
    """
    if not people:
        return np.zeros((len(times), 0, 2))
    return np.concatenate([_legs(person, T_world_robot, times) for person in people], axis=1)


def _legs(person: Person, T_world_robot: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2, 2): the left and the right leg."""
    path = _Path(person.path)
    walked, before = 0.0, float(times[0])
    bodies: list[tuple[float, float, float, float, float]] = []
    for (robot_x, robot_y), now in zip(T_world_robot[:, :2].tolist(), times.tolist(), strict=True):
        ahead = walked + person.speed * (now - before)
        before = now
        x, y, cos, sin = path.at(ahead)
        here_x, here_y, *_ = path.at(walked)
        distance = math.hypot(x - robot_x, y - robot_y)
        if distance < _WAITS_AT and distance < math.hypot(here_x - robot_x, here_y - robot_y):
            x, y, cos, sin = path.at(walked)
            distance = math.hypot(x - robot_x, y - robot_y)
        else:
            walked = ahead
        if distance < _STEPS_ASIDE_AT:
            away = _STEPS_ASIDE_AT / max(distance, 1e-9)
            x, y = robot_x + away * (x - robot_x), robot_y + away * (y - robot_y)
        bodies.append((x, y, cos, sin, walked))
    x, y, cos, sin, walked_so_far = np.array(bodies).T
    forward = _REACH * cos_sin(2 * math.pi * walked_so_far / _STRIDE)[1]
    legs = np.stack(
        [
            np.stack([x + side * (forward * cos - _HIP * sin), y + side * (forward * sin + _HIP * cos)], axis=1)
            for side in (1, -1)
        ],
        axis=1,
    )
    legs[(times < person.appears) | (times >= person.vanishes)] = np.nan
    return legs


class _Path:
    """A polyline by the distance walked along it, for ever."""

    def __init__(self, points: tuple[tuple[float, float], ...]) -> None:
        there = [point for point, before in zip(points, (None, *points), strict=False) if point != before]
        self._points = there if there[0] == there[-1] else there + there[-2::-1]
        legs = zip(self._points, self._points[1:], strict=False)
        self._starts = [0.0]
        for a, b in legs:
            self._starts.append(self._starts[-1] + math.dist(a, b))

    def at(self, walked: float) -> tuple[float, float, float, float]:
        """The place x, y and the direction cos, sin."""
        walked = math.fmod(walked, self._starts[-1])
        leg = min(bisect_right(self._starts, walked), len(self._points) - 1) - 1
        (ax, ay), (bx, by) = self._points[leg], self._points[leg + 1]
        length = self._starts[leg + 1] - self._starts[leg]
        cos, sin = (bx - ax) / length, (by - ay) / length
        along = walked - self._starts[leg]
        return ax + along * cos, ay + along * sin, cos, sin
