"""Geometric verification: put where a hypothesis has them, do scans agree with what else was seen there?

They would hardly do so by chance one after the other, and where they do at both of two places, nothing is decided.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import log

import numpy as np

from graph.arrays import Floats, Ints
from iceg.slam.closure_config import RelocalisationConfig
from iceg.slam.closures.attempt import Attempt
from iceg.slam.closures.candidates import ANCHOR_SPACING, Candidate
from iceg.slam.loop_closure import LoopCloser


@dataclass(frozen=True, slots=True, kw_only=True)
class FitCount:
    """How scans fit where they are put.

    Attributes:
        agreeing: matches that say the same.
        against: how many scans contradict what else was seen there, or fit better elsewhere.
        config: how many it takes.
    """

    agreeing: list[Attempt]
    against: int
    config: RelocalisationConfig = field(default_factory=RelocalisationConfig)

    @property
    def is_passed(self) -> bool:
        """Whether enough agree, and so few do not that they may well be put rightly."""
        return len(self.agreeing) >= self.config.min_agreeing and self.log_odds > -log(self.config.odds)

    @property
    def log_odds(self) -> float:
        """How much more probable it is that such counts come of scans that are put rightly, the logarithm."""
        return self.config.contradiction.log_odds(len(self.agreeing), self.against)


class GeometricVerifier:
    """Matches key scans after a break against everything before it."""

    def __init__(self, closer: LoopCloser) -> None:
        track, self._closer = closer.track, closer
        self._config = closer.config.relocalisation
        self._near = closer.config.verification.near
        self._n_keys = len(track.keys)
        self._path = track.path
        usual = max(float(np.median([key.motion.distance for key in track.keys])), 1e-3)
        self._spacing = int(np.clip(round(self._config.spacing / usual), 1, ANCHOR_SPACING))

    def of_scans(self, key: int, scans: Ints, T_map_scans: Floats, poses: Floats) -> FitCount:
        """Verify some scans after a break where something puts them.

        Args:
            key: the first key pose after the break.
            scans: (n,) key poses after it.
            T_map_scans: (n, 3) where they are put.
            poses: (k, 3) T_map_robot; those before the break are believed.
        """
        agreeing, against = [], 0
        for scan, T_map_scan in zip(scans.tolist(), T_map_scans, strict=True):
            for candidate in self._around(key, scan, T_map_scan, poses):
                attempt = self._closer.match(candidate, poses)
                if attempt.accepted and attempt.is_at(candidate.T_old_new, self._near):
                    agreeing.append(attempt)
                elif attempt.overlap >= self._config.min_overlap:
                    against += 1
        return FitCount(agreeing=agreeing, against=against, config=self._config)

    def of_closures(self, key: int, closures: Sequence[Attempt], poses: Floats) -> FitCount:
        """Verify the scans near the later ends of closures that span a break, where (k, 3) poses put them."""
        ends = np.array([closure.key_new for closure in closures])
        keys = np.arange(key, self._n_keys, self._spacing)
        far = np.abs(self._path[keys][:, None] - self._path[ends][None, :]).min(axis=1)
        near = keys[far < self._config.reach]
        some = near[:: max(1, -(-len(near) // self._config.max_keys))]
        return self.of_scans(key, some, poses[some], poses)

    def _around(self, key: int, scan: int, T_map_scan: Floats, poses: Floats) -> list[Candidate]:
        """Passes before a break around where a key scan is supposed to be, (3,) among (k, 3) poses."""
        supposed = poses[: scan + 1].copy()
        supposed[scan] = T_map_scan
        return self._closer.passes.within(scan, supposed, self._config.scan.deviations, key)
