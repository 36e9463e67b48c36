"""Pairwise consistency maximisation: the largest set of loop closures that agree with one another.

Mangelson et al., Pairwise consistent measurement set maximization for robust multi-robot map merging (2018). Two
closures agree when the cycle through both, along the chain between their ends, returns to where it began within its
covariance. Only differences of the chain's covariance enter, so a drift that both closures share excuses neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graph import _consistency_kernels as kernels
from graph.dense import congruence
from graph.errors import GraphError
from graph.factors import Factor
from graph.noise import information_of, largest_squared_norm
from graph.se2 import adjoint, between, compose, inverse

_UNTIED_SIGMA = 1e3  # [m, rad] of a step of the chain that no factor measures


@dataclass(frozen=True, kw_only=True)
class ConsistencyConfig:
    """When two closures agree, and how the largest agreeing set is searched.

    Attributes:
        probability: two true closures agree with this probability. A clique of a thousand holds half a million pairs,
            so anything far from 1 throws true closures away.
        exact_up_to: most closures with conflicts for which the largest clique is found exactly; beyond, those with
            most conflicts leave one by one.
    """

    probability: float = 1.0 - 1e-6
    exact_up_to: int = 60

    def __post_init__(self) -> None:
        if not 0.0 < self.probability < 1.0:
            raise GraphError(f"probability lies between 0 and 1, found {self.probability}")
        if self.exact_up_to < 0:
            raise GraphError(f"exact_up_to is not negative, found {self.exact_up_to}")


def consistent_closures(
    closures: Sequence[Factor],
    poses: NDArray[np.float64],
    chain: Sequence[Factor],
    config: ConsistencyConfig | None = None,
) -> NDArray[np.bool_]:
    """Which closures belong to the largest set that agrees pairwise.

    Args:
        closures: relative poses between key poses far apart in time.
        poses: (n, 3) estimate of T_map_robot the cycles are closed along; without the closures in question, or their
            errors hide in it.
        chain: factors along the way; those between neighbouring poses give the chain's covariance.
        config: gate and search.

    Returns:
        (m,) true for those in the set.

    Raises:
        GraphError: a closure joins a pose that is not there.
    """
    settings = config or ConsistencyConfig()
    cumulative = cumulative_covariances(chain, poses)
    consistent = pairwise_consistency(closures, poses, cumulative, settings.probability)
    return maximum_clique(consistent, settings.exact_up_to)


def cumulative_covariances(chain: Sequence[Factor], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance of every pose given only the steps from its predecessors, perturbing it from the left.

    In the map's tangent space covariances of steps simply add, so the one between two poses is a difference.

    Args:
        chain: factors; those between neighbouring poses count, several between the same two add their information.
        poses: (n, 3) T_map_robot.

    Returns:
        (n, 3, 3), the first zero.
    """
    steps = [factor for factor in chain if factor.i is not None and abs(factor.j - factor.i) == 1]
    information = np.zeros((max(len(poses) - 1, 0), 3, 3))
    information[:] = np.eye(3) / _UNTIED_SIGMA**2
    if steps:
        later = np.array([max(factor.j, factor.i or 0) for factor in steps])
        forward = np.array([factor.j > (factor.i or 0) for factor in steps])
        strength = information_of(np.array([factor.covariance for factor in steps]))
        measured = np.array([factor.T_i_j for factor in steps])
        turned = adjoint(np.where(forward[:, None], np.zeros(3), inverse(measured)))  # of a factor that looks back
        np.add.at(information, later - 1, congruence(np.swapaxes(turned, -1, -2), strength))
    carry = adjoint(poses[1:])
    in_map = congruence(carry, information_of(information))
    return np.concatenate([np.zeros((1, 3, 3)), np.cumsum(in_map, axis=0)])


def pairwise_consistency(
    closures: Sequence[Factor],
    poses: NDArray[np.float64],
    cumulative: NDArray[np.float64],
    probability: float = ConsistencyConfig.probability,
) -> NDArray[np.bool_]:
    """(m, m) whether each two closures agree.

    Args:
        closures: relative poses; m of them.
        poses: (n, 3) T_map_robot along the chain.
        cumulative: (n, 3, 3) of `cumulative_covariances`.
        probability: two true closures agree with this probability.

    Raises:
        GraphError: a closure joins a pose that is not there.
    """
    for closure in closures:
        if closure.i is None or not (0 <= closure.i < len(poses) and 0 <= closure.j < len(poses)):
            raise GraphError(f"{closure} is no closure between two of the {len(poses)} poses there are")
    if not closures:
        return np.zeros((0, 0), dtype=bool)
    ends = np.array([(closure.i, closure.j) for closure in closures], dtype=np.int64)
    T_i_j = np.array([closure.T_i_j for closure in closures])
    covariance = np.array([closure.covariance for closure in closures])
    backwards = ends[:, 0] > ends[:, 1]  # all from the earlier pose to the later one
    turn = adjoint(T_i_j)
    covariance = np.where(backwards[:, None, None], congruence(turn, covariance), covariance)
    T_i_j = np.where(backwards[:, None], inverse(T_i_j), T_i_j)
    ends = np.sort(ends, axis=1)
    T_map_j = compose(poses[ends[:, 0]], T_i_j)
    carry = adjoint(T_map_j)
    return np.asarray(
        kernels.consistent_pairs(
            np.ascontiguousarray(ends[:, 0]),
            np.ascontiguousarray(ends[:, 1]),
            between(inverse(T_map_j), inverse(poses[ends[:, 1]])),
            congruence(carry, covariance),
            cumulative,
            largest_squared_norm(probability),
        )
    )


def maximum_clique(
    consistent: NDArray[np.bool_], exact_up_to: int = ConsistencyConfig.exact_up_to
) -> NDArray[np.bool_]:
    """(m,) members of the largest set in which everyone agrees with everyone.

    Who agrees with all is in it anyway; among the rest the search is exact up to `exact_up_to` of them (branch and
    bound with a colouring, Tomita & Seki 2003), greedy beyond. Of equally large sets the same one is always found.
    """
    graph = consistent | np.eye(len(consistent), dtype=bool)
    members = np.asarray(kernels.greedy_clique(graph), dtype=bool) if len(graph) else np.zeros(0, dtype=bool)
    contested = np.flatnonzero(~graph.all(axis=1))
    if 0 < len(contested) <= exact_up_to:
        inside = graph[np.ix_(contested, contested)]
        best = _exact_clique(inside, np.flatnonzero(members[contested]).tolist())
        members[contested] = False
        members[contested[best]] = True
    return members


def _exact_clique(consistent: NDArray[np.bool_], start: list[int]) -> list[int]:
    """The largest clique of a small graph, sets of vertices as bits of integers."""
    n = len(consistent)
    neighbours = [sum(1 << b for b in range(n) if b != a and consistent[a, b]) for a in range(n)]
    best = start

    def expand(chosen: list[int], candidates: int) -> None:
        nonlocal best
        for vertex, bound in reversed(_coloured(candidates, neighbours)):
            if len(chosen) + bound <= len(best):
                return
            chosen.append(vertex)
            remaining = candidates & neighbours[vertex]
            if remaining:
                expand(chosen, remaining)
            elif len(chosen) > len(best):
                best = chosen.copy()
            chosen.pop()
            candidates &= ~(1 << vertex)

    expand([], (1 << n) - 1)
    return sorted(best)


def _coloured(candidates: int, neighbours: list[int]) -> list[tuple[int, int]]:
    """Vertices with the number of their colour, increasing: a clique among the first k needs at most its colour."""
    ordered, colour = [], 0
    while candidates:
        colour += 1
        independent = candidates
        while independent:
            lowest = independent & -independent
            vertex = lowest.bit_length() - 1
            ordered.append((vertex, colour))
            candidates ^= lowest
            independent &= ~(neighbours[vertex] | lowest)
    return ordered
