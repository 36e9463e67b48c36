"""Where a robot may have got to since the newest match, by how far its steps usually are."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from graph.arrays import Floats
from iceg.slam.agreement import apart
from iceg.slam.tracking_config import OdometryCheckConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """How far a robot may have gone.

    Attributes:
        T_track_before: (3,) the newest pose that a match told.
        most: (2,) how far [m] the robot may have gone since, and turned [rad], as its steps are.
    """

    T_track_before: Floats
    most: Floats

    def after(self, step: Floats) -> "Reach":
        """After one more step, of (2,) at most."""
        return Reach(T_track_before=self.T_track_before, most=self.most + step)

    def log_probability(self, T_track_robot: Floats, carried: float) -> float:
        """How probable it is that a robot goes as far as to a (3,) pose, against one that hardly moves, the logarithm.

        Args:
            T_track_robot: the pose.
            carried: probability that it goes farther than its steps reach.
        """
        moved, most = apart(self.T_track_before, T_track_robot), self.most.tolist()
        ratio2 = sum((way / far) ** 2 for way, far in zip(moved, most, strict=True))
        return math.log((1.0 - carried) * math.exp(-0.5 * ratio2) + carried)


class UsualReach:
    """How far a robot gets from scan to scan, as its odometry says; farther where its matches do.

    Odometry may be in other units, or hardly count at all.
    """

    def __init__(self, config: OdometryCheckConfig) -> None:
        """Nothing is known yet but what any robot does."""
        self._config = config
        self._least = self._told = np.array([config.reach_distance, config.reach_turn])
        self._mean, self._n_steps = np.zeros(2), 0

    @property
    def most(self) -> Floats:
        """(2,) distance [m] and turn [rad]."""
        most: Floats = np.maximum(self._told, self._config.reach_of_mean * self._mean)
        return most

    def expect(self, told: Floats) -> None:
        """Odometry tells of (2,) steps."""
        self._told = np.maximum(self._least, told)

    def add(self, T_track_robots: Floats) -> None:
        """Matches told (n, 3) poses, one scan after the other."""
        poses = T_track_robots.tolist()  # a few at a time: NumPy would take ten times as long
        ways = [math.hypot(x - x0, y - y0) for (x0, y0, _), (x, y, _) in pairwise(poses)]
        turns = [abs(math.remainder(turn - turn0, math.tau)) for (_, _, turn0), (_, _, turn) in pairwise(poses)]
        steps = len(ways)
        self._n_steps = min(self._config.reach_scans, self._n_steps + steps)
        mean = np.array([math.fsum(ways) / steps, math.fsum(turns) / steps])
        self._mean = self._mean + (mean - self._mean) * min(1.0, steps / self._n_steps)
