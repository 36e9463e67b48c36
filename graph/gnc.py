"""Graduated non-convexity with truncated least squares: which suspect factors hold, and the poses they agree on.

Yang et al., Graduated non-convexity for robust spatial perception (2020). The cost grows from nearly convex to
truncated; here it starts late, at a cost that already fades ten standard deviations out, because the start is taken
from a robust optimum: from the fully convex end, false loops drag M3500 into a wrong valley again.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graph.problem import Problem

_FIRST_MU = 0.01
"""Least first μ: a single gross residual would ask for many more rounds."""
_MU_FACTOR = 1.4
"""Growth of μ from round to round (Yang et al. 2020)."""
_MOST_ROUNDS = 60
_STEPS_PER_ROUND = 2
"""Gauss-Newton steps between two changes of the weights."""
_MOST_REVISIONS = 4
"""In the end, how often the inliers are chosen anew and solved for again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GncResult:
    """Truncated least squares.

    Attributes:
        poses: (n, 3) T_map_robot.
        inliers: (m,) which factors hold; known inliers always do.
        error_before: half the sum of squares at the start, each suspect's truncated at the gate.
        error_after: half the sum of squares of the factors that hold, at `poses`.
        iterations: steps taken.
    """

    poses: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    error_before: float
    error_after: float
    iterations: int


def gnc_tls(
    problem: Problem, suspects: NDArray[np.bool_], active: NDArray[np.bool_], poses: NDArray[np.float64], gate: float
) -> GncResult:
    """Solve for poses and for which suspects hold.

    Args:
        problem: all factors, the suspects without robust kernel.
        suspects: (m,) factors that may be false; the others determine every pose.
        active: (m,) factors worth weighing; suspects beyond are far off at the start.
        poses: (n, 3) start, from a robust optimum.
        gate: largest squared norm [standard deviations] of a suspect that holds.

    Returns:
        Poses and inliers; every suspect within the gate at these poses holds, every other does not.
    """
    at = problem.evaluate(poses)
    error_before = float(np.where(suspects, np.minimum(at.losses, 0.5 * gate), at.losses).sum())
    trusted = active & suspects
    weighed, among = problem.restricted_to(active), suspects[active]
    squared, iterations = at.squared[active], 0
    mu = _first_mu(squared[among], gate)
    for _ in range(_MOST_ROUNDS):
        weights = np.where(among, _weights(squared, gate, mu), 1.0)
        solved = weighed.descend(poses, trust=weights, max_iterations=_STEPS_PER_ROUND, relative_tolerance=1e-5)
        poses, iterations = solved.poses, iterations + solved.iterations
        squared = weighed.evaluate(poses).squared
        if np.isin(weights, (0.0, 1.0)).all():
            break
        mu *= _MU_FACTOR
    trusted[active] &= weights > 0.5
    for _ in range(_MOST_REVISIONS):
        solved = problem.restricted_to(~suspects | trusted).descend(poses)
        poses, iterations = solved.poses, iterations + solved.iterations
        within = suspects & (problem.evaluate(poses).squared <= gate)
        if np.array_equal(within, trusted):
            break
        trusted = within
    solved = problem.restricted_to(~suspects | trusted).descend(poses)
    return GncResult(
        poses=solved.poses,
        inliers=~suspects | trusted,
        error_before=error_before,
        error_after=solved.error_after,
        iterations=iterations + solved.iterations,
    )


def _first_mu(squared: NDArray[np.float64], gate: float) -> float:
    """Yang's start from the largest residual, but not before `_FIRST_MU`."""
    excess = 2.0 * float(squared.max(initial=0.0)) - gate
    return max(_FIRST_MU, gate / excess) if excess > 0.0 else 1e12


def _weights(squared: NDArray[np.float64], gate: float, mu: float) -> NDArray[np.float64]:
    between = np.sqrt(gate * mu * (mu + 1.0) / np.maximum(squared, 1e-9)) - mu
    weights = np.where(squared >= (mu + 1.0) / mu * gate, 0.0, np.clip(between, 0.0, 1.0))
    return np.where(squared <= mu / (mu + 1.0) * gate, 1.0, weights)
