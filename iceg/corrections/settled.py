"""Where a graph settles with closures by hand in it, and what they contradict.

A closure by hand may lie far from the estimate, where its robust kernel rejects it although it is right: so it is
also tried with the graph pulled there first. That is kept where it costs less; and where it costs no other closure, for
then a person's word stands against the path alone, which drifts by more than it claims.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.batch import optimize
from graph.factors import Factor
from graph.problem import Problem
from iceg.slam.config import FinishConfig
from iceg.slam.solution import BATCH

_GAIN = 1e-6
"""Costs that differ by less are equal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contradiction:
    """How far a closure by hand is from what the rest of the graph says.

    Attributes:
        sigmas: by so many standard deviations: of its own, or of the path where the path follows it.
        closures: so many others hold without it, and not with it.
        is_followed: whether the path is bent for it all the same.
    """

    sigmas: float
    closures: int
    is_followed: bool = False

    @property
    def sentence(self) -> str:
        """For a person: what contradicts the closure, and by how much."""
        if self.closures == 1:
            who = "another closure contradicts it"
        elif self.closures:
            who = f"{self.closures} other closures contradict it"
        elif self.is_followed:
            who = "the path, bent for it, contradicts it"
        else:
            who = "the path contradicts it"
        return f"{who}, {self.sigmas:.0f} standard deviations off"


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """The optimum of a graph, and how its factors lie there.

    Attributes:
        factors: of the graph.
        poses: (k, 3) T_map_robot of the key poses.
        cost: sum of all losses.
        weights: (m,) that the robust kernels leave.
        sigmas: (m,) how many standard deviations each factor is off.
    """

    factors: Sequence[Factor]
    poses: NDArray[np.float64]
    cost: float
    weights: NDArray[np.float64]
    sigmas: NDArray[np.float64]

    @property
    def holding(self) -> set[int]:
        """Identities of the closures that their kernels do not reject."""
        pairs = zip(self.factors, self.weights.tolist(), strict=True)
        return {id(factor) for factor, weight in pairs if factor.kind == "closure" and weight >= 1.0}

    def weight_of(self, factor: Factor) -> float:
        """Weight that its kernel leaves one of the factors."""
        return float(self.weights[self._row(factor)])

    def sigmas_of(self, factor: Factor) -> float:
        """How many standard deviations one of the factors is off."""
        return float(self.sigmas[self._row(factor)])

    def _row(self, factor: Factor) -> int:
        return next(row for row, other in enumerate(self.factors) if other is factor)


def settled(
    factors: Sequence[Factor], added: Sequence[Factor], poses: NDArray[np.float64], config: FinishConfig
) -> Settled:
    """The best optimum of a graph with closures by hand.

    Args:
        factors: of the graph, those closures among them.
        added: the closures by hand that have a robust kernel.
        poses: (k, 3) first guesses.
        config: how far the path is bent for one of them.
    """
    best = _solved(factors, poses)
    rejected = [factor for factor in added if best.weight_of(factor) < 1.0]
    trials = [rejected] if len(rejected) < 2 else [rejected, *([factor] for factor in rejected)]
    for trial in trials if rejected else []:
        if all(best.weight_of(factor) >= 1.0 for factor in trial):
            continue
        found = _solved(factors, _pulled(factors, trial, best.poses))
        loses_none = not best.holding - found.holding
        most = best.cost + 0.5 * config.by_hand_sigmas**2 * len(trial) if loses_none else best.cost - _GAIN
        if found.cost < most and all(found.weight_of(factor) >= 1.0 for factor in trial):
            best = found
    return best


def contradiction(
    here: Settled, factor: Factor, poses: NDArray[np.float64], config: FinishConfig
) -> Contradiction | None:
    """What a closure by hand contradicts; None if it agrees with the rest.

    Args:
        here: the optimum with it.
        factor: the closure; one without a kernel is believed there, and is judged by what was without it.
        poses: (k, 3) of the graph without it.
        config: from where on it is told that the path is bent.
    """
    if factor.kernel is None:
        without = _solved([other for other in here.factors if other is not factor], poses)
        lost = without.holding - here.holding
        sigmas = _sigmas(factor, without.poses)
        return Contradiction(sigmas=sigmas, closures=len(lost), is_followed=True) if lost else None
    if here.weight_of(factor) >= 1.0:
        without = _solved([other for other in here.factors if other is not factor], poses)
        bent = (2.0 * max(0.0, here.cost - without.cost)) ** 0.5
        lost = without.holding - here.holding
        return Contradiction(sigmas=bent, closures=len(lost), is_followed=True) if bent > config.told_sigmas else None
    believed = _at(here.factors, _pulled(here.factors, [factor], here.poses))
    lost = here.holding - believed.holding - {id(factor)}
    return Contradiction(sigmas=here.sigmas_of(factor), closures=len(lost))


def _solved(factors: Sequence[Factor], poses: NDArray[np.float64]) -> Settled:
    return _at(factors, optimize(factors, poses, BATCH).poses)


def _at(factors: Sequence[Factor], poses: NDArray[np.float64]) -> Settled:
    at = Problem.of(factors, len(poses)).evaluate(poses)
    cost = float(at.losses.sum())
    return Settled(factors=factors, poses=poses, cost=cost, weights=at.weights, sigmas=np.sqrt(at.squared))


def _pulled(factors: Sequence[Factor], trial: Collection[Factor], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 3) the optimum with some closures believed."""
    tried = set(map(id, trial))
    believed = [replace(factor, kernel=None) if id(factor) in tried else factor for factor in factors]
    return optimize(believed, poses, BATCH).poses


def _sigmas(factor: Factor, poses: NDArray[np.float64]) -> float:
    return float(np.sqrt(Problem.of([factor], len(poses)).evaluate(poses).squared[0]))
