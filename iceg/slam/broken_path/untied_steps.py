"""Steps of the path that no loop closure vouches for: where it may be broken, or may have drifted away."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from graph.factors import Factor
from graph.measurement import NoMatch
from iceg.slam.broken_path.path_break import Doubt, DoubtKind
from iceg.slam.config import LoopClosureConfig
from iceg.slam.track import KeyScan, Track

_LOG_END = 12.0
"""A break so near to the beginning or the end of the path matters to nobody [m]."""
_VOUCHED = 10
"""Closures that span a doubtful step and settle the doubt."""
_WEAK_SCORE = 0.7
"""A match that explains less of a scan leaves room for doubt where few closures span it."""


class UntiedSteps:
    """The steps that nothing spans, that few span and little explains, or that are in doubt, while closures enter."""

    def __init__(
        self, track: Track, factors: Sequence[Factor], doubts: Mapping[int, Doubt], config: LoopClosureConfig
    ) -> None:
        """Start with the closures found on the way.

        Args:
            track: key scans.
            factors: of the graph.
            doubts: by key pose, where the path may be broken.
            config: on which key scans closures rest.
        """
        self._keys = track.keys
        self._config = config
        inner = amid_the_path(track)
        spanned = closures_across(factors, len(track.keys), config)
        self.doubts = {
            key: doubt for key, doubt in doubts.items() if doubt.is_lost or (inner[key] and spanned[key] < _VOUCHED)
        }
        """Those that closures have not settled."""
        scores = np.array([_score(key) for key in track.keys])
        self._weak = inner & (scores < _WEAK_SCORE) & (spanned < _VOUCHED)
        self.untied = inner & (spanned == 0) | self._weak
        """(k,) whether nothing ties the step that leads to a key pose."""
        self.untied[list(self.doubts)] = True

    def doubt(self, key: int) -> Doubt:
        """What speaks against the step to a key pose; where nothing does, how little its match explained."""
        known = self.doubts.get(key)
        if known is not None:
            return known
        score = _score(self._keys[key])
        reason = f"only {score:.0%} of the beams agreed with what was known before"
        return Doubt(kind=DoubtKind.WEAK_MATCH, reason=reason, unexplained=1.0 - score)

    def refuted(self) -> list[int]:
        """The key poses before which odometry and match contradict each other, or the robot was lost."""
        return [key for key, doubt in self.doubts.items() if doubt.is_beyond_chance]

    def rank(self, key: int) -> float:
        """Compares the steps that may be broken: the highest is where a break is put.

        A match that explains all of a scan knows better than an odometry that jumped or slipped.
        """
        unexplained = 1.0 - _score(self._keys[key])
        return self.doubts[key].rank + unexplained if key in self.doubts else unexplained

    def tie(self, factors: Sequence[Factor]) -> None:
        """Leave out the steps that the closures of a graph span by now."""
        spanned = closures_across(factors, len(self._keys), self._config)
        self.untied &= (spanned == 0) | (self._weak & (spanned < _VOUCHED))
        self.untied[list(self.doubts)] = True


def amid_the_path(track: Track) -> NDArray[np.bool_]:
    """(k,) which key poses lie neither near the beginning nor near the end of the path."""
    path = np.cumsum([key.motion.distance for key in track.keys])
    return np.asarray((path > _LOG_END) & (path < path[-1] - _LOG_END), dtype=np.bool_)


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
