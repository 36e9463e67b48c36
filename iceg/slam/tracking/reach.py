"""Where a robot may have got to since the newest match, by how far its steps usually are."""

import math
from dataclasses import dataclass, replace

from graph.arrays import Floats
from iceg.slam.agreement import apart


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
        return replace(self, most=self.most + step)

    def log_probability(self, T_track_robot: Floats, carried: float) -> float:
        """How probable it is that a robot goes as far as to a (3,) pose, against one that hardly moves, the logarithm.

        Args:
            T_track_robot: the pose.
            carried: probability that it goes farther than its steps reach.
        """
        moved, most = apart(self.T_track_before, T_track_robot), self.most.tolist()
        ratio2 = sum((way / far) ** 2 for way, far in zip(moved, most, strict=True))
        return math.log((1.0 - carried) * math.exp(-0.5 * ratio2) + carried)
