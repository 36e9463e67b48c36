"""Steps that tell nothing, across a sudden loss that nothing else joins."""

from collections.abc import Sequence
from dataclasses import replace

from graph.factors import Factor
from iceg.slam.broken_path.path_break import Break, Outcome
from iceg.slam.track import UNKNOWN_STEP


def without_lost_steps(factors: Sequence[Factor], breaks: Sequence[Break]) -> list[Factor]:
    """The factors of a graph, steps telling nothing where they alone hold what a sudden loss has torn apart.

    Where what the laser sees changed at once the robot may have been carried anywhere. Elsewhere it went by dead
    reckoning, and odometry tells the truth.

    Args:
        factors: of the graph.
        breaks: of the path; those that are apart matter.
    """
    torn = [found.key for found in breaks if found.outcome is Outcome.APART and found.is_sudden]
    return [replace(factor, covariance=UNKNOWN_STEP) if _is_across(factor, torn) else factor for factor in factors]


def _is_across(factor: Factor, torn: Sequence[int]) -> bool:
    """Whether a factor of the path leads across the step to one of some key poses."""
    if factor.i is None or factor.kind == "closure":
        return False
    return any(factor.i < key <= factor.j for key in torn)
