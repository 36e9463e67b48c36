"""Geometric verification: put where a hypothesis has them, do scans agree with what else was seen there?

They would hardly do so by chance one after the other, and where they do at both of two places, nothing is decided.
"""

from dataclasses import dataclass

from graph.arrays import Floats, Ints
from iceg.slam.closures.attempt import Attempt
from iceg.slam.closures.candidates import Candidate
from iceg.slam.loop_closure import LoopCloser


@dataclass(frozen=True, slots=True, kw_only=True)
class FitCount:
    """How scans fit where they are put.

    Attributes:
        agreeing: matches that say the same.
        log_odds: how many times as probable it is that as many agree, and as many do not, where scans are put rightly,
            as where they are not, the logarithm.
    """

    agreeing: list[Attempt]
    log_odds: float


class GeometricVerifier:
    """Matches key scans after a break against everything before it."""

    def __init__(self, closer: LoopCloser) -> None:
        self._closer = closer
        self._config = closer.config.relocalisation
        self._near = closer.config.verification.near

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
        return FitCount(agreeing=agreeing, log_odds=self._config.contradiction.log_odds(len(agreeing), against))

    def _around(self, key: int, scan: int, T_map_scan: Floats, poses: Floats) -> list[Candidate]:
        """Passes before a break around where a key scan is supposed to be, (3,) among (k, 3) poses."""
        supposed = poses[: scan + 1].copy()
        supposed[scan] = T_map_scan
        config = self._config
        return self._closer.passes.before(key, scan, supposed, config.scan.deviations, config.maps.reach)
