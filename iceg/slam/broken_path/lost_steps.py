"""Steps that tell nothing, across a sudden loss that nothing else joins."""

from collections.abc import Sequence
from dataclasses import replace

from graph.factors import Factor
from iceg.slam.broken_path.path_break import Break, Outcome
from iceg.slam.track import UNKNOWN_STEP


def without_lost_steps(factors: Sequence[Factor], breaks: Sequence[Break], min_credible: int) -> list[Factor]:
    """The factors of a graph, steps telling nothing where they alone hold what a sudden loss has torn apart.

    Where what the laser sees changed at once the robot may have been carried anywhere. Elsewhere it went by dead
    reckoning, and odometry tells the truth; it does, too, where scans agree with what it says, if not enough of them
    to hold the path together.

    Args:
        factors: of the graph.
        breaks: of the path; those that are apart matter.
        min_credible: so many scans that agree with odometry make it credible that the robot was not carried, even where
            as many do not.
    """
    torn = {
        found.key
        for found in breaks
        if found.outcome is Outcome.APART and found.closures < min_credible and found.is_sudden
    }
    return [
        replace(factor, covariance=UNKNOWN_STEP) if factor.kind in {"odometry", "ice"} and factor.j in torn else factor
        for factor in factors
    ]
