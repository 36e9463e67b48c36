"""Bridge edges: steps of the path that no loop closure spans, where it may be broken or may have drifted away."""

from collections.abc import Collection, Mapping, Sequence
from math import log

import numpy as np

from graph.arrays import Ints
from graph.factors import Factor
from graph.measurement import NoMatch
from iceg.slam.broken_path.path_break import FailureKind, TrackingFailure
from iceg.slam.closure_config import TrackingFailureConfig
from iceg.slam.config import LoopClosureConfig
from iceg.slam.track import KeyScan, Track


class BridgeEdges:
    """Steps that nothing spans, that few span and little explains, or at which tracking failed, as closures enter."""

    def __init__(
        self,
        track: Track,
        factors: Sequence[Factor],
        failures: Mapping[int, TrackingFailure],
        config: LoopClosureConfig,
    ) -> None:
        """Start with the closures found on the way, and, by key pose, where the path may be broken."""
        self._keys = track.keys
        self._config = config
        spanned = self.closures_across(factors)
        known = settled(failures, spanned, config.failures)
        self.failures = {key: failure for key, failure in failures.items() if key > 0 and key not in known}
        """Those that closures have not settled."""
        scores = np.array([_score(key) for key in track.keys])
        self._weak = scores < config.failures.min_inlier_ratio
        self._weak &= spanned < config.failures.settling_closures
        self.is_bridge = np.arange(len(track.keys)) > 0
        """(k,) whether the step that leads to a key pose is a bridge."""
        self.update(factors)

    def failure(self, key: int) -> TrackingFailure:
        """What speaks against the step to a key pose; where nothing does, how little its match explained.

        Somebody may be carried all the same, but seldom.
        """
        known = self.failures.get(key)
        if known is not None:
            return known
        score = _score(self._keys[key])
        reason = f"only {score:.0%} of the beams agreed with what was known before"
        return TrackingFailure(
            kind=FailureKind.LOW_INLIER_RATIO,
            reason=reason,
            unexplained=1.0 - score,
            log_odds_carried=log(self._config.view.carried_prior * self._config.view.unnoticed),
        )

    def chains(self, besides: Collection[int] = ()) -> list[tuple[int, Ints]]:
        """The chains of bridges by their later key poses, each with the one whose match explains least of its scan.

        Args:
            besides: key poses; a chain with one of them is left out.
        """
        bridges = np.flatnonzero(self.is_bridge)
        found = (part for part in np.split(bridges, np.flatnonzero(np.diff(bridges) > 1) + 1) if len(part))
        return [(self._weakest(part), part) for part in found if not np.isin(part, list(besides)).any()]

    def weakest(self, first: int, last: int) -> int:
        """Of the bridges up to one the one whose match explains least of its scan, by its later key pose.

        Args:
            first: key pose; no earlier bridge is meant …
            last: … nor a later one, which is a bridge.
        """
        within = np.arange(first, last + 1)
        return self._weakest(within[self.is_bridge[within]])

    def _weakest(self, keys: Ints) -> int:
        scores = [_score(self._keys[key]) for key in keys.tolist()]
        return int(keys[int(np.argmin(scores))])

    def closures_across(self, factors: Sequence[Factor]) -> Ints:
        """(k,) how many closures span the step that leads to each key pose, with all the key scans they rest on."""
        return closures_across(factors, len(self._keys), self._config)

    def update(self, factors: Sequence[Factor]) -> None:
        """Leave out the steps that the closures of a graph span by now."""
        spanned = self.closures_across(factors)
        self.is_bridge &= (spanned == 0) | (self._weak & (spanned < self._config.failures.settling_closures))
        self.is_bridge[list(self.failures)] = True


def closures_across(factors: Sequence[Factor], n_keys: int, config: LoopClosureConfig) -> Ints:
    """(n_keys,) how many closures of a graph span the step to each key pose, with all the key scans they rest on."""
    closures = [factor.pair for factor in factors if factor.kind == "closure"]
    ends = np.sort(np.array(closures, dtype=np.int64).reshape(-1, 2), axis=1)
    rest_on = np.array([config.reference_half, min(config.support_offsets)])
    return _spanning(ends + rest_on, n_keys)


def settled(failures: Mapping[int, TrackingFailure], across: Ints, config: TrackingFailureConfig) -> set[int]:
    """The key poses of failures that (n_keys,) closures across their steps settle; nothing does where all was lost."""
    return {key for key, failure in failures.items() if not failure.is_lost and across[key] >= config.settling_closures}


def _spanning(ends: Ints, n_keys: int) -> Ints:
    """(n_keys,) how many of (n, 2) pairs of key poses the step to each one lies between."""
    first, last = ends[ends[:, 0] < ends[:, 1]].T
    change = np.bincount(first + 1, minlength=n_keys + 1) - np.bincount(last + 1, minlength=n_keys + 1)
    return np.cumsum(change)[:n_keys]


def _score(key: KeyScan) -> float:
    """Of the match of a key scan, 0 without one."""
    return 0.0 if isinstance(key.match, NoMatch) else key.match.score
