"""A robot's velocity where nothing but matches tells it: a Kalman filter of constant velocity.

A match that comes back onto a wall after many steps along a corridor makes up for all of them at once. Whoever takes
that step for the velocity runs away with it; the filter knows that tracking may be off by many small errors, and gives
each its share (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, chapter
6). A robot keeps its velocity in its own frame, goes ahead rather than aside, and turns with its matches.
"""

import numpy as np

from graph.arrays import Floats
from graph.se2 import compose
from iceg.slam.tracking import _velocity_kernels as kernels
from iceg.slam.tracking_config import VelocityFilterConfig

_MOST_STEPS = 100
"""A robot is expected to go on as before for so many scans at most, 10 s at 10 Hz."""


class VelocityFilter:
    """The velocity of a robot from scan to scan."""

    def __init__(self, velocity: Floats, config: VelocityFilterConfig) -> None:
        """Start with (2,) a velocity along the robot and to its side [m per scan], where tracking is not off."""
        self._config = config
        self._velocity = velocity.copy()
        floor = config.match_deviation**2
        self._spread = np.diag([floor, floor, config.ahead_at_first**2, config.aside_at_first**2])

    def copy(self) -> "VelocityFilter":
        """Another one that knows as much, to try what comes next."""
        other = VelocityFilter(self._velocity, self._config)
        other._spread = self._spread.copy()
        return other

    @property
    def velocity(self) -> Floats:
        """(2,) along the robot and to its side, as the matches so far tell it [m per scan]."""
        return self._velocity.copy()

    def step(self, turn: float) -> Floats:
        """(3,) the next step of a robot that turns by so much [rad]; from now on it is expected to have made it."""
        config = self._config
        ahead, aside = config.change_ahead**2, config.change_aside**2
        kernels.predict(self._velocity, self._spread, turn, config.kept_aside, ahead, aside)
        return np.array([*self._velocity, turn])

    def way(self, turn: float, steps: int) -> Floats:
        """(3,) so many steps in a row, each with the same turn [rad]; no robot goes on as before for ever."""
        way = np.zeros(3)
        for _ in range(min(steps, _MOST_STEPS)):
            way = compose(way, self.step(turn))
        return way

    def correct(self, offset: Floats, information: Floats) -> None:
        """Learn from a match.

        Args:
            offset: (2,) position in the frame of the robot where it was expected to be [m] …
            information: (2, 2) … and how well the scan measures that [1/m²].
        """
        floor = self._config.match_deviation**2
        kernels.correct(self._velocity, self._spread, offset, information, self._config.points_together, floor)
