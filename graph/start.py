"""A start for all poses that finds its way: closures enter in the order of time, each judged by all before it.

A chain of odometry may be off by more than half a turn at its end, and least squares from there ends in a wrong valley.
Growing the graph a batch of closures at a time, with a few steps each, keeps every closure near what is known so far.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graph.problem import Problem

_BATCHES = 16
"""Parts in which the graph grows along the path …"""
_STEPS_PER_BATCH = 4
"""… and most steps after each."""
_MOST_ROUNDS = 6
_FAR_WHILE_GROWING, _FAR_IN_THE_END = 1e4, 1e2


@dataclass(frozen=True, slots=True, kw_only=True)
class GrownStart:
    """A start and who has a say in it.

    Attributes:
        poses: (n, 3) T_map_robot.
        active: (m,) whether each factor was near enough to pull.
        iterations: steps taken.
    """

    poses: NDArray[np.float64]
    active: NDArray[np.bool_]
    iterations: int


def grown_start(
    problem: Problem, suspects: NDArray[np.bool_], chained: NDArray[np.float64], fade_at: float | None
) -> GrownStart:
    """Poses from a chain, corrected by one batch of suspect factors after the other.

    Args:
        problem: all factors, with robust kernels if the suspects may be false.
        suspects: (m,) factors that may be false; the others determine every pose.
        chained: (n, 3) first guesses that satisfy the others.
        fade_at: squared norm [standard deviations] at which the suspects' kernel begins to fade: one far beyond it is
            left out until the rest agrees with it, which keeps false loops out of the linear systems. None keeps all.

    Returns:
        The poses after all batches.
    """
    poses, iterations = chained, 0
    newest = np.maximum(problem.i, problem.j)
    for last in _batch_ends(newest[suspects]):
        so_far = ~suspects | (newest <= last)
        near = so_far & _near(problem, poses, suspects, fade_at, _FAR_WHILE_GROWING)
        grown = problem.restricted_to(near).descend(poses, max_iterations=_STEPS_PER_BATCH, relative_tolerance=1e-4)
        poses, iterations = grown.poses, iterations + grown.iterations
    active = np.zeros_like(suspects)
    for _ in range(_MOST_ROUNDS):
        near = _near(problem, poses, suspects, fade_at, _FAR_IN_THE_END)
        if np.array_equal(near, active):
            break
        active = near
        grown = problem.restricted_to(active).descend(poses, relative_tolerance=1e-6)
        poses, iterations = grown.poses, iterations + grown.iterations
    return GrownStart(poses=poses, active=active, iterations=iterations)


def _batch_ends(newest: NDArray[np.int64]) -> NDArray[np.int64]:
    """The newest pose of each batch, batches of equal numbers of suspects."""
    if not len(newest):
        return newest
    ends = np.sort(newest)[np.linspace(0, len(newest) - 1, _BATCHES + 1).astype(np.int64)[1:]]
    return np.unique(ends)


def _near(
    problem: Problem, poses: NDArray[np.float64], suspects: NDArray[np.bool_], fade_at: float | None, far: float
) -> NDArray[np.bool_]:
    if fade_at is None:
        return np.ones_like(suspects)
    return np.asarray(~suspects | (problem.evaluate(poses).squared < far * fade_at))
