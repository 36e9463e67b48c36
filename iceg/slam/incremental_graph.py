"""The back end over a track that still grows: a bounded amount of work with every scan."""

from collections import deque
from collections.abc import Iterator

import numpy as np

from graph.arrays import Floats
from graph.odometry import OdometryMotion
from iceg.config import Config
from iceg.slam.back_end import BackEnd
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.solution import Solution
from iceg.slam.stages import Stages
from iceg.slam.track import KeyScan, Track

_BEHIND = 8
"""Key scans that wait for their search for loops; for each so many more, one more match is made with every scan."""
_ENDED = object()
"""Instead of a pause, from a search that has come to its end."""


class IncrementalGraph:
    """Key poses in the graph at once; loops looked for a little later, match by match.

    A closure asks the neighbours of its key scan, later ones, too: the search waits for them.
    """

    def __init__(
        self, keys: list[KeyScan], lost: list[int], matcher: MapMatcher, config: Config, stages: Stages
    ) -> None:
        """Start with the first key scan.

        Args:
            keys: the front end's list of key scans, which grows.
            lost: its list of scans from which on nothing matched what was known.
            matcher: for loop closures.
            config: widened for the noise of the laser.
            stages: candidates and verification of the caller's own.
        """
        nothing = np.zeros(0, dtype=np.int64)
        track = Track(keys=keys, key_of_scan=nothing, T_key_scan=np.zeros((0, 3)), failures=0, lost=lost)
        self._keys = keys
        self._closer = LoopCloser(matcher, track, config.loops, stages=stages)
        self._back_end = BackEnd(self._closer, config.graph)
        self._lookahead = max(0, *config.loops.support_offsets)
        self._waiting: deque[int] = deque()
        self._search: Iterator[None] = iter(())
        self.newest = self._solved()
        """(3,) T_map_robot of the newest key pose and its (3, 3) marginal covariance, tangent space at it."""

    def extend(self, motion: OdometryMotion | None) -> None:
        """Add the newest key scan, the next one, with the odometry since the one before."""
        key = len(self._keys) - 1
        self._closer.passes.extend()
        self._back_end.extend(key, motion)
        self._waiting.append(key)
        self.newest = self._solved()

    def search_on(self) -> bool:
        """One match of the search for loops, or a few if many wait; whether a loop was closed."""
        before = self._back_end.n_closed
        for _ in range(1 + len(self._waiting) // _BEHIND):
            self._one_match()
        if self._back_end.n_closed == before:
            return False
        self.newest = self._solved()
        return True

    @property
    def poses(self) -> Floats:
        """(k, 3) T_map_robot of the key poses."""
        return self._back_end.graph.all_poses()

    def solution(self) -> Solution:
        """The graph so far, see `BackEnd.solution`."""
        return self._back_end.solution()

    def _solved(self) -> tuple[Floats, Floats]:
        """The newest key pose as iSAM2 has it."""
        graph, newest = self._back_end.graph, len(self._back_end.graph) - 1
        covariance = graph.marginal_covariance(newest)
        return graph.pose(newest), covariance

    def _one_match(self) -> None:
        """Go on with the search that runs, or begin the next that is due."""
        while next(self._search, _ENDED) is _ENDED:
            if not self._waiting or self._waiting[0] + self._lookahead >= len(self._keys):
                return
            self._search = self._back_end.search(self._waiting.popleft())
