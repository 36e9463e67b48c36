"""Geometric verification of a hypothesis, and of the present estimate by the same scans.

Put as it says, do the scans after the break agree with what was seen there before it? They would hardly do so by
chance one after the other, and where they do at both places, nothing is decided.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import log

import numpy as np

from graph.arrays import Bools, Floats, Ints
from graph.se2 import between, compose
from iceg.slam.broken_path.place_hypothesis import Hypothesis
from iceg.slam.closure_config import RelocalisationConfig
from iceg.slam.closures.attempt import Attempt, closed_pose
from iceg.slam.closures.candidates import ANCHOR_SPACING, Candidate
from iceg.slam.loop_closure import LoopCloser


@dataclass(frozen=True, slots=True, kw_only=True)
class FitCount:
    """How scans fit where they are put.

    Attributes:
        agreeing: matches that say the same.
        against: how many scans contradict what else was seen there, or fit better elsewhere.
        support: how many key scans said so before these were asked; 0 where none was.
        config: how many it takes.
    """

    agreeing: list[Attempt]
    against: int
    support: int = 0
    config: RelocalisationConfig = field(default_factory=RelocalisationConfig)

    @property
    def is_passed(self) -> bool:
        """Whether enough agree, and so few do not that they may well be put rightly."""
        return len(self.agreeing) >= self.config.min_agreeing and self.log_odds > -log(self.config.odds)

    @property
    def is_sure(self) -> bool:
        """Whether, besides, they are more probably put rightly than not."""
        return self.is_passed and self.log_odds > 0.0

    @property
    def log_odds(self) -> float:
        """How much more probable it is that such counts come of scans that are put rightly, the logarithm."""
        counted = self.config.contradiction.log_odds(len(self.agreeing), self.against)
        if not self.support:
            return counted
        return counted + self.config.alike_exponent * log(self.support / self.config.alike_scans)

    def beats(self, other: "FitCount", log_prior: float = 0.0) -> bool:
        """Whether this is clearly the more probable of two.

        Args:
            other: how the scans fit elsewhere.
            log_prior: the logarithm of what else makes the other so many times as probable.
        """
        return self.log_odds - other.log_odds - log_prior > log(self.config.odds)


class HypothesisVerifier:
    """Matches key scans after a break against everything before it."""

    def __init__(self, closer: LoopCloser) -> None:
        track, self._closer = closer.track, closer
        self._config = closer.config.relocalisation
        self._near = closer.config.verification.near
        self._keys = track.keys
        self._path = track.path
        usual = max(float(np.median([key.motion.distance for key in track.keys])), 1e-3)
        self._spacing = int(np.clip(round(self._config.spacing / usual), 1, ANCHOR_SPACING))

    def of_hypothesis(self, hypothesis: Hypothesis, poses: Floats) -> FitCount:
        """Verify scans where a hypothesis puts them.

        Args:
            hypothesis: what is claimed.
            poses: (k, 3) T_map_robot; those before the break are believed.
        """
        seen = []
        for key, nearest in self._to_verify(hypothesis):
            # Key scans lie to the later end of the closure as the front end saw them.
            T_near_key = between(self._keys[nearest.key_new].T_track_robot, self._keys[key].T_track_robot)
            around = self._around(key, compose(closed_pose(nearest, poses), T_near_key), poses, hypothesis)
            # other passes may have drifted away from this one
            most, at = self._config.pass_length, self._path[nearest.key_old]
            seen += [candidate for candidate in around if abs(self._path[candidate.key_old] - at) <= most]
        return replace(self._count(seen, poses), support=hypothesis.support)

    def of_scans(self, key: int, scans: Ints, T_map_scans: Floats, poses: Floats) -> FitCount:
        """Verify some scans after a break where something puts them.

        Args:
            key: the first key pose after the break.
            scans: (n,) key poses after it.
            T_map_scans: (n, 3) where they are put.
            poses: (k, 3) T_map_robot; those before the break are believed.
        """
        nothing = Hypothesis(key=key, closures=[])
        seen = [
            candidate
            for scan, T_map_scan in zip(scans.tolist(), T_map_scans, strict=True)
            for candidate in self._around(scan, T_map_scan, poses, nothing)
        ]
        return self._count(seen, poses)

    def of_estimate(self, hypothesis: Hypothesis, poses: Floats, among: Bools | None = None) -> FitCount:
        """Verify the same scans where the poses put them.

        Args:
            hypothesis: what is claimed.
            poses: (k, 3) T_map_robot.
            among: (k,) the key poses that the scans are compared with; all before the break if left out.
        """
        seen = [
            candidate
            for key, _ in self._to_verify(hypothesis)
            for candidate in self._around(key, poses[key], poses, hypothesis)
            if among is None or among[candidate.key_old]
        ]
        return self._count(seen, poses)

    def _to_verify(self, hypothesis: Hypothesis) -> list[tuple[int, Attempt]]:
        """Key poses near those of a hypothesis, each with the closure nearest to it along the path."""
        path, ends = self._path, np.array([closure.key_new for closure in hypothesis.closures])
        keys = np.arange(hypothesis.key, len(self._keys), self._spacing)
        far = np.abs(path[keys][:, None] - path[ends][None, :])
        near = np.flatnonzero(far.min(axis=1) < self._config.reach)
        near = near[:: max(1, -(-len(near) // self._config.max_keys))]
        return [(int(keys[k]), hypothesis.closures[int(far[k].argmin())]) for k in near]

    def _around(self, key: int, T_map_key: Floats, poses: Floats, hypothesis: Hypothesis) -> list[Candidate]:
        """Passes before the break around where a key scan is supposed to be, (3,) among (k, 3) poses."""
        supposed = poses[: key + 1].copy()
        supposed[key] = T_map_key
        return self._closer.passes.within(key, supposed, self._config.scan.deviations, hypothesis.key)

    def _count(self, seen: Sequence[Candidate], poses: Floats) -> FitCount:
        agreeing, against = [], 0
        for candidate in seen:
            attempt = self._closer.match(candidate, poses)
            if attempt.accepted and attempt.is_at(candidate.T_old_new, self._near):
                agreeing.append(attempt)
            elif attempt.overlap >= self._config.min_overlap:
                against += 1
        return FitCount(agreeing=agreeing, against=against, config=self._config)
