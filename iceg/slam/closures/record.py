"""The record of all loop closures tried, as the graph changes: what it contradicts taken out, what was before kept."""

from collections.abc import Sequence
from dataclasses import replace

from graph.arrays import Floats
from graph.factors import Factor
from graph.problem import Problem
from iceg.slam.closures.attempt import Attempt


def without_contradicted(
    attempts: Sequence[Attempt], loops: Sequence[Factor], poses: Floats, outlier_weight: float
) -> tuple[list[Attempt], list[Factor]]:
    """Take out the closures that the rest of the graph contradicts so much that they no longer pull.

    Args:
        attempts: all that were tried.
        loops: the factors of those accepted, each with its robust kernel.
        poses: (n, 3) the optimum of all factors.
        outlier_weight: a closure whose kernel leaves it less is an outlier.

    Returns:
        The attempts, those taken out marked, and the factors that stay.
    """
    if not loops:
        return list(attempts), []
    at = Problem.of(loops, len(poses)).evaluate(poses)
    gone = {
        loop.pair: f"contradicted by the rest of the graph, {norm**0.5:.0f} standard deviations off"
        for loop, weight, norm in zip(loops, at.weights.tolist(), at.squared.tolist(), strict=True)
        if weight < outlier_weight
    }
    judged = [
        attempt.taken_out(why) if attempt.accepted and (why := gone.get(attempt.pair)) is not None else attempt
        for attempt in attempts
    ]
    return judged, [loop for loop in loops if loop.pair not in gone]


def with_earlier(last: Sequence[Attempt], earlier: Sequence[Attempt]) -> list[Attempt]:
    """The record of all closures in the order of the path; those tried last in the place of the same tried before.

    What the search on the way has found of the path and of other places stays told.
    """
    before, known = {attempt.pair: attempt for attempt in earlier}, {attempt.pair for attempt in last}
    others = [attempt for attempt in earlier if attempt.pair not in known]
    renewed = [
        replace(attempt, places=attempt.places or found.places, off_path=found.off_path)
        if (found := before.get(attempt.pair)) is not None
        else attempt
        for attempt in last
    ]
    return sorted([*others, *renewed], key=lambda attempt: (attempt.key_new, attempt.key_old))
