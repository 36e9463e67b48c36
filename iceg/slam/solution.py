"""A solved graph with its closures and the breaks of its path, and what becomes of it as more is found out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from graph.arrays import Bools, Floats
from graph.batch import BatchConfig, optimize
from graph.factors import Factor
from graph.se2 import compose
from graph.short_repr import short_repr
from iceg.slam.agreement import Tolerance
from iceg.slam.broken_path.path_break import Break
from iceg.slam.broken_path.place_votes import Vote
from iceg.slam.closures.attempt import Attempt, closure_factor
from iceg.slam.track import UNKNOWN_STEP

BATCH = BatchConfig(max_iterations=50, relative_tolerance=1e-6, absolute_tolerance=1e-4)
"""How a whole graph is solved during a run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """A solved graph, what is known of its closures, and where its path is broken.

    Attributes:
        factors: in force, each once.
        poses: (k, 3) T_map_robot of the key poses.
        attempts: every loop closure that was tried.
        searchable: (k,) which key scans later ones are matched against; the others lie in confirmed areas.
        odometry_jumps: key poses whose match contradicted odometry.
        breaks: where the path from scan to scan does not hold, in its order.
        ambiguous: where no loop was closed, since several places fit as well.
    """

    factors: list[Factor]
    poses: Floats
    attempts: list[Attempt]
    searchable: Bools
    odometry_jumps: tuple[int, ...] = ()
    breaks: tuple[Break, ...] = ()
    ambiguous: tuple[Vote, ...] = ()

    __repr__ = short_repr

    def closed(self, closures: Sequence[Attempt]) -> "Solution":
        """With more closures, but those between key poses that one joins already, and solved."""
        joined = {factor.pair for factor in self.factors if factor.kind == "closure"}
        fresh = [closure for closure in closures if closure.pair not in joined]
        why = f"map merging, with {len(closures) - 1} others"
        factors = [*self.factors, *map(closure_factor, fresh)]
        return replace(
            self,
            factors=factors,
            poses=optimize(factors, self.poses, BATCH).poses,
            attempts=[*self.attempts, *(replace(c, reason=f"{why}; {c.reason}") for c in fresh)],
        )

    def without(self, closures: Sequence[Attempt], why: str) -> "Solution":
        """Without some of its closures, and solved."""
        gone = {closure.pair for closure in closures}
        factors = [factor for factor in self.factors if factor.kind != "closure" or factor.pair not in gone]
        return replace(
            self,
            factors=factors,
            poses=optimize(factors, self.poses, BATCH).poses,
            attempts=[a.taken_out(why) if a.accepted and a.pair in gone else a for a in self.attempts],
        )

    def moved(
        self, key: int, closures: Sequence[Attempt], correction: Floats, moving: Bools, near: Tolerance
    ) -> "Solution":
        """Without an edge of the path and the closures that contradict others, what follows moved to where these say.

        Args:
            key: the key pose that the step leads to.
            closures: that say so.
            correction: (3,) in the map.
            moving: (k,) the key poses that it moves.
            near: closures between what moves and what does not stay if they agree with the poses then.
        """
        poses = self.poses.copy()
        poses[moving] = compose(correction, poses[moving])
        torn = {
            attempt.pair
            for attempt in self.attempts
            if attempt.accepted
            and moving[attempt.key_old] != moving[attempt.key_new]
            and not attempt.is_near(poses, near)
        }
        why = f"contradicted by {len(closures)} closures that agree"
        attempts = [a.taken_out(why) if a.accepted and a.pair in torn else a for a in self.attempts]
        factors = [
            factor if factor.kind == "closure" or not _spans(factor, key) else replace(factor, covariance=UNKNOWN_STEP)
            for factor in self.factors
            if factor.kind != "closure" or factor.pair not in torn
        ]
        return replace(self, factors=factors, poses=poses, attempts=attempts).closed(closures)


def _spans(factor: Factor, key: int) -> bool:
    return factor.i is not None and min(factor.i, factor.j) < key <= max(factor.i, factor.j)
