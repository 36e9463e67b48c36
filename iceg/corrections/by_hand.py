"""Closures by hand on their way into the graph: matched where only scans are given, factors between key poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.dense import congruence
from graph.factors import Factor, RobustKernel
from graph.se2 import adjoint, compose, inverse
from iceg.config import Config
from iceg.corrections.manual_closures import ManualClosure
from iceg.slam.closures.attempt import Attempt, Verdict, closure_factor
from iceg.slam.closures.candidates import Candidate
from iceg.slam.closures.closure import Closure
from iceg.slam.finish import closure_kernel
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.map_matcher import MapMatcher
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
    closures: Sequence[ManualClosure], track: Track, matcher: MapMatcher, poses: NDArray[np.float64], config: Config
) -> list[ByHand]:
    """What becomes of closures by hand; those without a pose are matched.

    Args:
        closures: by hand, of scans the track has.
        track: key scans.
        matcher: for those that only name scans.
        poses: (k, 3) T_map_robot of the key poses, good between neighbours.
        config: what is a match, and how the pull of those fades that are not pinned.
    """
    kernel = closure_kernel(config.finish)
    are_posed = all(closure.T_i_j is not None for closure in closures)
    closer = None if are_posed else LoopCloser(matcher, track, config.loops)
    return [_by_hand(closure, track, closer, poses, None if closure.pinned else kernel) for closure in closures]


def manual_factor(closure: ManualClosure, track: Track, kernel: RobustKernel | None = None) -> Factor | None:
    """A closure of scans as a factor between the key poses these scans are tied to.

    T_keyi_keyj = T_keyi_i · T_i_j · T_keyj_j⁻¹, and its covariance is carried along by the adjoint of T_keyj_j.

    Args:
        closure: by hand, of scans the track has, its pose known.
        track: key scans, and where every other scan lies in the frame of its key scan.
        kernel: how its pull fades.

    Returns:
        The factor; None for two scans of one key pose, which the graph cannot move against each other.
    """
    i, j = int(track.key_of_scan[closure.scan_i]), int(track.key_of_scan[closure.scan_j])
    if i == j:
        return None
    assert closure.T_i_j is not None
    T_keyi_i, T_keyj_j = track.T_key_scan[closure.scan_i], track.T_key_scan[closure.scan_j]
    sigmas = np.array([closure.sigma_m, closure.sigma_m, closure.sigma_rad])
    return Factor(
        kind="closure",
        i=i,
        j=j,
        T_i_j=compose(compose(T_keyi_i, closure.T_i_j), inverse(T_keyj_j)),
        covariance=congruence(adjoint(T_keyj_j), np.diag(sigmas**2)),
        kernel=kernel,
    )


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
