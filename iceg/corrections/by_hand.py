"""Closures by hand on their way into the graph: matched where only scans are given, factors between key poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.factors import Factor, RobustKernel
from graph.se2 import compose, inverse
from iceg.corrections.manual_closures import ManualClosure, manual_factor
from iceg.slam.closures.attempt import Attempt, Verdict, closure_factor
from iceg.slam.closures.candidates import Candidate
from iceg.slam.closures.closure import Closure
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.track import Track

_SAME_KEY = "by hand; both scans hang on the same key pose"


@dataclass(frozen=True, slots=True, kw_only=True)
class ByHand:
    """A closure by hand.

    Attributes:
        closure: what the person says.
        factor: of the graph; None where there can be none.
        match: what the matcher found, where it was asked.
        reason: for the record.
    """

    closure: ManualClosure
    factor: Factor | None
    match: Attempt | None = None
    reason: str

    def record(self, verdict: Verdict, track: Track) -> Closure:
        """For the record of closures."""
        match = None if self.match is None else self.match.match
        given = self.closure.T_i_j
        return Closure(
            scan_i=self.closure.scan_i,
            scan_j=self.closure.scan_j,
            T_i_j=self._of_scans(track) if given is None else given,
            score=0.0 if match is None else match.score,
            inliers=0 if match is None else match.inliers,
            overlap=0.0 if match is None else match.overlap,
            verdict=verdict,
            reason=self.reason,
        )

    def _of_scans(self, track: Track) -> NDArray[np.float64]:
        """(3,) how the scans lie to each other, as the key poses they hang on were matched; NaN where they were not."""
        if self.factor is None:
            return np.full(3, np.nan)
        scan_i, scan_j = self.closure.scan_i, self.closure.scan_j
        T_keyi_keyj = self.factor.T_i_j
        if self.factor.i != track.key_of_scan[scan_i]:
            T_keyi_keyj = inverse(T_keyi_keyj)
        return compose(compose(inverse(track.T_key_scan[scan_i]), T_keyi_keyj), track.T_key_scan[scan_j])


def closures_by_hand(
    closures: Sequence[ManualClosure],
    track: Track,
    closer: LoopCloser | None,
    poses: NDArray[np.float64],
    kernel: RobustKernel,
) -> list[ByHand]:
    """What becomes of closures by hand; those without a pose are matched.

    Args:
        closures: by hand, of scans the track has.
        track: key scans.
        closer: matches those that only name scans; None where there are none.
        poses: (k, 3) T_map_robot of the key poses, good between neighbours.
        kernel: of those that are not pinned.
    """
    return [_by_hand(closure, track, closer, poses, None if closure.pinned else kernel) for closure in closures]


def _by_hand(
    closure: ManualClosure,
    track: Track,
    closer: LoopCloser | None,
    poses: NDArray[np.float64],
    kernel: RobustKernel | None,
) -> ByHand:
    said = "by hand, pinned" if closure.pinned else "by hand"
    keys = sorted(track.key_of_scan[[closure.scan_i, closure.scan_j]].tolist())
    if keys[0] == keys[1]:
        return ByHand(closure=closure, factor=None, reason=_SAME_KEY)
    if closure.T_i_j is not None:
        return ByHand(closure=closure, factor=manual_factor(closure, track, kernel), reason=said)
    assert closer is not None
    found = _matched(closer, keys[0], keys[1], poses)
    if not found.accepted:
        return ByHand(closure=closure, factor=None, match=found, reason=f"{said}; the matcher found: {found.reason}")
    factor = closure_factor(found, kernel)
    return ByHand(closure=closure, factor=factor, match=found, reason=f"{said}, matched; {found.reason}")


def _matched(closer: LoopCloser, key_old: int, key_new: int, poses: NDArray[np.float64]) -> Attempt:
    """Where one key scan fits the surroundings of another: wherever that is, else close to the estimate."""
    anywhere = closer.match_anywhere(key_old, key_new, poses)
    if anywhere.accepted:
        return anywhere
    deviations = closer.config.verification.trusted.deviations
    near = closer.match(Candidate.of(key_old, key_new, poses, deviations), poses)
    return near if near.accepted else replace(anywhere, accepted=False)
