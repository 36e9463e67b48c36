"""Closures that agree about how what follows a step of the path lies to what was before.

One pair of similar places says nothing (perceptual aliasing). Several that agree pairwise along the path as the front
end saw it are a hypothesis, to be verified.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from graph.arrays import Bools, Floats
from graph.consistency import cumulative_covariances, maximum_clique, pairwise_consistency
from graph.factors import Factor
from graph.noise import chi2_gate, squared_norm
from graph.se2 import compose, inverse, logmap
from iceg.slam.broken_path.bridge_edges import BridgeEdges
from iceg.slam.broken_path.path_parts import PathParts
from iceg.slam.closure_config import RelocalisationConfig
from iceg.slam.closures.attempt import Attempt, closed_pose, closure_factor


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """Closures that agree about how what follows a key pose lies to what was before.

    Attributes:
        key: the first key pose after the break, or after the part whose drift they end.
        closures: they.
    """

    key: int
    closures: list[Attempt]

    @property
    def support(self) -> int:
        """How many key scans say so."""
        return len({closure.key_new for closure in self.closures})

    def without(self, pairs: Collection[tuple[int, int]]) -> "Hypothesis":
        """The same without the closures that join some pairs of key poses."""
        return Hypothesis(key=self.key, closures=[c for c in self.closures if c.pair not in pairs])

    def correction(self, poses: Floats) -> Floats:
        """(3,) what moves the poses after the break, in the map: that of the closure nearest to the break."""
        return implied_correction(min(self.closures, key=lambda closure: closure.key_new), poses)

    def distance_from(self, other: "Hypothesis", poses: Floats) -> float:
        """How far apart the two put the same scan [m]; 0 if they are about different scans.

        Args:
            other: what another claims.
            poses: (k, 3) T_map_robot.
        """
        ends, others = ([closure.key_new for closure in each.closures] for each in (self, other))
        if min(ends) > max(others) or min(others) > max(ends):
            return 0.0
        key = max(min(ends), min(others))
        here, there = (
            compose(implied_correction(min(each.closures, key=lambda c: abs(c.key_new - key)), poses), poses[key])
            for each in (self, other)
        )
        return float(np.hypot(*(here - there)[:2]))

    def is_chance(self, factors: Sequence[Factor], poses: Floats, config: RelocalisationConfig) -> bool:
        """Whether the path explains it by chance, without a bias; arguments as of `is_drift`."""
        return self.is_drift(factors, poses, config, np.ones(len(poses), dtype=np.bool_))

    def is_drift(
        self, factors: Sequence[Factor], poses: Floats, config: RelocalisationConfig, is_bridge: Bools | None = None
    ) -> bool:
        """Whether the errors of the path explain it, step by step.

        Args:
            factors: of the path.
            poses: (k, 3) T_map_robot.
            config: how far chance and a bias go.
            is_bridge: (k,) the steps to key poses that no closure spans, where something else speaks against the path:
                it drifts along them, hardly elsewhere. If left out, errors may be larger than it claims, and a bias.
        """
        cumulative = cumulative_covariances(factors, poses)
        if is_bridge is not None:
            steps = np.diff(cumulative, axis=0, prepend=np.zeros((1, 3, 3)))
            cumulative = np.cumsum(np.where(is_bridge[:, None, None], 1.0, config.spanned_covariance) * steps, axis=0)
        for closure in self.closures:
            error = logmap(implied_correction(closure, poses))
            covariance = cumulative[closure.key_new] - cumulative[closure.key_old]
            n_steps = closure.key_new - closure.key_old
            most = config.bias_sigmas**2 * n_steps if is_bridge is None else chi2_gate(config.false_alarm)
            if squared_norm(error, covariance) > most:
                return False
        return True


def agreeing_sets(
    closures: Sequence[Attempt], factors: Sequence[Factor], poses: Floats, fewest: int
) -> list[list[Attempt]]:
    """Sets of closures that agree pairwise along the path, the largest first.

    Args:
        closures: that matched.
        factors: of the path.
        poses: (k, 3) T_map_robot: the path as the front end saw it, or with what closures said of it since.
        fewest: closures of a set.
    """
    cumulative = cumulative_covariances(factors, poses)
    agree = pairwise_consistency([closure_factor(closure) for closure in closures], poses, cumulative)
    left, sets = np.arange(len(closures)), []
    while len(left) >= fewest:
        members = maximum_clique(agree[np.ix_(left, left)])
        sets.append([closures[index] for index in left[members].tolist()])
        left = left[~members]
    return sorted(sets, key=len, reverse=True)


def about_single_steps(closures: Sequence[Attempt], steps: BridgeEdges) -> list[Hypothesis]:
    """What closures that agree say about single steps, that about the one that most of them span first."""
    found, left = [], list(closures)
    while (key := steps.spanned_by_most(left)) is not None:
        found.append(Hypothesis(key=key, closures=[c for c in left if c.spans(key)]))
        left = [closure for closure in left if not closure.spans(key)]
    return found


def about_parts(closures: Sequence[Attempt], parts: PathParts) -> list[Hypothesis]:
    """What closures that agree say about how parts of the path lie to each other, that of most closures first.

    Each is about the beginning of the later part that most of its closures span.
    """
    between_wholes: dict[tuple[int, int], list[Attempt]] = {}
    for closure in closures:
        if not parts.is_within(closure):
            between_wholes.setdefault(parts.of(closure), []).append(closure)
    found = []
    for group in between_wholes.values():
        spanning = {key: [c for c in group if c.spans(key)] for key in parts.starts}
        key = max(parts.starts, key=lambda start: (len(spanning[start]), start))
        found.append(Hypothesis(key=key, closures=spanning[key]))
    return sorted(found, key=lambda hypothesis: -hypothesis.support)


def implied_correction(closure: Attempt, poses: Floats) -> Floats:
    """(3,) what moves the later key pose, in the map, to where a closure puts it."""
    return compose(closed_pose(closure, poses), inverse(poses[closure.key_new]))
