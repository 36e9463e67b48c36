"""Bridge edges: steps of the path that no loop closure spans, where it may be broken or may have drifted away."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from graph.factors import Factor
from graph.measurement import NoMatch
from iceg.slam.broken_path.path_break import FailureKind, TrackingFailure
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
        """Start with the closures found on the way.

        Args:
            track: key scans.
            factors: of the graph.
            failures: by key pose, where the path may be broken.
            config: on which key scans closures rest.
        """
        self._keys = track.keys
        self._config = config
        self.most_share = config.relocalisation.most_share
        """See `RelocalisationConfig`."""
        inner = amid_the_path(track, config.failures.log_end)
        spanned = closures_across(factors, len(track.keys), config)
        settling = config.failures.settling_closures
        self.failures = {
            key: failure
            for key, failure in failures.items()
            if failure.is_lost or (inner[key] and spanned[key] < settling)
        }
        """Those that closures have not settled."""
        scores = np.array([_score(key) for key in track.keys])
        self._weak = inner & (scores < config.failures.min_inlier_ratio) & (spanned < settling)
        self.is_bridge = inner & (spanned == 0) | self._weak
        """(k,) whether the step that leads to a key pose is a bridge."""
        self.is_bridge[list(self.failures)] = True

    def failure(self, key: int) -> TrackingFailure:
        """What speaks against the step to a key pose; where nothing does, how little its match explained."""
        known = self.failures.get(key)
        if known is not None:
            return known
        score = _score(self._keys[key])
        reason = f"only {score:.0%} of the beams agreed with what was known before"
        return TrackingFailure(kind=FailureKind.LOW_INLIER_RATIO, reason=reason, unexplained=1.0 - score)

    def refuted(self) -> list[int]:
        """The key poses before which odometry and match contradict each other, or the robot was lost."""
        return [key for key, failure in self.failures.items() if failure.is_beyond_chance(self._config.failures)]

    def rank(self, key: int) -> float:
        """Compares the steps that may be broken: the highest is where a break is put.

        A match that explains all of a scan knows better than an odometry that jumped or slipped.
        """
        unexplained = 1.0 - _score(self._keys[key])
        return self.failures[key].rank + unexplained if key in self.failures else unexplained

    def update(self, factors: Sequence[Factor]) -> None:
        """Leave out the steps that the closures of a graph span by now."""
        spanned = closures_across(factors, len(self._keys), self._config)
        self.is_bridge &= (spanned == 0) | (self._weak & (spanned < self._config.failures.settling_closures))
        self.is_bridge[list(self.failures)] = True


def amid_the_path(track: Track, end: float) -> NDArray[np.bool_]:
    """(k,) which key poses lie neither near the beginning nor near the end of the path."""
    path = np.cumsum([key.motion.distance for key in track.keys])
    return np.asarray((path > end) & (path < path[-1] - end), dtype=np.bool_)


def closures_across(factors: Sequence[Factor], n_keys: int, config: LoopClosureConfig) -> NDArray[np.int64]:
    """(n_keys,) how many closures span the step that leads to each key pose, with all the key scans they rest on."""
    change = np.zeros(n_keys + 1, dtype=np.int64)
    before, after = config.reference_half, min(config.support_offsets)
    for factor in factors:
        if factor.kind == "closure" and factor.i is not None:
            first, last = min(factor.i, factor.j) + before, max(factor.i, factor.j) + after
            if first < last:
                change[first + 1] += 1
                change[last + 1] -= 1
    return np.cumsum(change)[:-1]


def _score(key: KeyScan) -> float:
    """Of the match of a key scan, 0 without one."""
    return 0.0 if isinstance(key.match, NoMatch) else key.match.score
