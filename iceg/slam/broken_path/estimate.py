"""A graph with its closures and the breaks of its path, and how what is found out changes it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.batch import BatchConfig, optimize
from graph.factors import Factor
from graph.se2 import compose
from iceg.slam.agreement import Tolerance
from iceg.slam.broken_path.path_break import Break
from iceg.slam.broken_path.place_votes import Vote
from iceg.slam.closures.attempt import Attempt, closure_factor, is_near
from iceg.slam.track import UNKNOWN_STEP

BATCH = BatchConfig(max_iterations=50, relative_tolerance=1e-6, absolute_tolerance=1e-4)
"""How a whole graph is solved during a run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A graph, what is known of its closures, and where its path is broken.

    Attributes:
        factors: in force.
        poses: (k, 3) T_map_robot of the key poses.
        attempts: every loop closure tried.
        breaks: in the order of the path.
        ambiguous: where several places explain what was seen about as well.
    """

    factors: list[Factor]
    poses: NDArray[np.float64]
    attempts: list[Attempt]
    breaks: tuple[Break, ...] = ()
    ambiguous: tuple[Vote, ...] = ()


class ChangingEstimate:
    """The same while closures enter and leave, and parts of the path move."""

    def __init__(self, start: Estimate, near: Tolerance) -> None:
        """Start with an estimate; closures that agree with it to within `near` stay when parts move."""
        self._near = near
        self.factors, self.poses = start.factors, start.poses
        self.attempts = list(start.attempts)

    def close(self, closures: Sequence[Attempt]) -> None:
        """Let closures into the graph, but those between key poses that one joins already, and solve it."""
        joined = {(factor.i, factor.j) for factor in self.factors if factor.kind == "closure"}
        fresh = [c for c in closures if (c.key_old, c.key_new) not in joined]
        self.attempts += [
            replace(c, reason=f"place recognition, with {len(closures) - 1} others; {c.reason}") for c in fresh
        ]
        self.factors = [*self.factors, *(closure_factor(closure) for closure in fresh)]
        self._solve()

    def move(
        self, key: int, closures: Sequence[Attempt], correction: NDArray[np.float64], moving: NDArray[np.bool_]
    ) -> None:
        """Remove an edge of the path, move what follows to where closures put it, and take out what contradicts them.

        Args:
            key: the key pose that the step leads to.
            closures: they.
            correction: (3,) in the map.
            moving: (k,) the key poses that it moves.
        """
        self.poses = self.poses.copy()
        self.poses[moving] = compose(correction, self.poses[moving])
        self.factors = [
            replace(factor, covariance=UNKNOWN_STEP) if _spans(factor, key) and factor.kind != "closure" else factor
            for factor in self.factors
        ]
        torn = [
            attempt
            for attempt in self.attempts
            if moving[attempt.key_old] != moving[attempt.key_new]
            and attempt.accepted
            and not is_near(attempt, self.poses, self._near)
        ]
        self._take_out(torn, f"contradicted by {len(closures)} closures that agree")
        self.close(closures)

    def _take_out(self, closures: Sequence[Attempt], why: str) -> None:
        """Remove closures that were accepted."""
        gone = {(closure.key_old, closure.key_new) for closure in closures}
        for index, attempt in enumerate(self.attempts):
            if attempt.accepted and (attempt.key_old, attempt.key_new) in gone:
                self.attempts[index] = replace(attempt, accepted=False, removed=True, reason=f"{why}; {attempt.reason}")
        self.factors = [f for f in self.factors if f.kind != "closure" or (f.i, f.j) not in gone]

    def _solve(self) -> None:
        self.poses = optimize(self.factors, self.poses, BATCH).poses


def _spans(factor: Factor, key: int) -> bool:
    return factor.i is not None and min(factor.i, factor.j) < key <= max(factor.i, factor.j)
