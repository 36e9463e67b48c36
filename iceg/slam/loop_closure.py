"""Places seen again: candidates from the graph, ICE against a local map of the earlier pass, verification."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.matcher import Matcher
from graph.factors import Factor, RobustKernel
from graph.measurement import NoMatch, RelativePose
from graph.problem import Problem
from graph.se2 import between, compose
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.ice.verification import Agreement
from iceg.slam.config import LoopClosureConfig
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One loop closure that was tried.

    Attributes:
        key_old: index of the earlier key pose.
        key_new: index of the later one.
        match: what the matcher said, None if it found nothing credible.
        accepted: whether it may enter the graph.
        reason: why, or why not.
        overlap: share of the beams that fall on the earlier pass at the best pose found.
        removed: whether it was in the graph before it was found to be wrong.
    """

    key_old: int
    key_new: int
    match: RelativePose | None
    accepted: bool
    reason: str
    overlap: float = 0.0
    removed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """An earlier pass that may have seen what a key scan sees."""

    key_old: int
    key_new: int
    T_old_new: NDArray[np.float64]
    deviations: NDArray[np.float64]


_NEAR_DEVIATIONS = np.array([0.3, 0.3, 0.1])
"""Up to here a search trusts the estimate [m, m, rad]."""
ANCHOR_SPACING = 4
"""Key poses from one reference to the next."""
_REFERENCES_KEPT = 6
_STILL = 0.01
"""A reference is built anew when its scans have moved by more than this against each other [m, rad]."""
_EXACT_DEVIATIONS = np.array([0.03, 0.03, 0.01])
_ANYWHERE_DEVIATIONS = np.array([1.0, 1.0, np.pi / 3.0])
"""Two places that look alike are searched within three times this [m, m, rad]."""


_NEAR_DISTANCE, _NEAR_TURN = 0.4, 0.12
"""A closure no farther than this from the estimate [m, rad] is near it."""
_PARTNER_KEYS, _PARTNER_DISTANCE, _PARTNER_TURN = 60, 0.25, 0.05
"""Two closures within so many key poses confirm each other when they differ by less than this [m, rad]."""


class Drift:
    """How uncertain the path between two key poses is, by chaining the steps since the last closure."""

    def __init__(self, n_keys: int) -> None:
        self._position = np.zeros(n_keys)
        self._heading = np.zeros(n_keys)
        self._last_closure = 0

    def add(self, key: int, covariance: NDArray[np.float64]) -> None:
        """Add the (3, 3) covariance of the step that leads to `key`."""
        self._position[key] = max(covariance[0, 0], covariance[1, 1])
        self._heading[key] = covariance[2, 2]

    def close(self, key: int) -> None:
        """A closure at `key` ends the drift of everything before it."""
        self._last_closure = key

    def between(self, key_old: int, key_new: int, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(2,) standard deviations of position [m] and heading [rad] of the later pose relative to the earlier."""
        steps = slice(max(key_old, self._last_closure) + 1, key_new + 1)
        lever2 = np.sum((poses[steps, :2] - poses[key_new, :2]) ** 2, axis=1)
        heading = self._heading[steps]
        variances = np.array([np.sum(self._position[steps] + heading * lever2), np.sum(heading)])
        return np.asarray(np.sqrt(variances), dtype=np.float64)


def closure_factor(attempt: Attempt, kernel: RobustKernel | None = None) -> Factor:
    """A closure that was matched, as a factor of the graph."""
    assert attempt.match is not None
    return Factor(
        kind="closure",
        i=attempt.key_old,
        j=attempt.key_new,
        T_i_j=attempt.match.T_ref_cur,
        covariance=attempt.match.covariance,
        kernel=kernel,
    )


_CONTRADICTED = 0.01
"""A closure whose robust kernel leaves it a smaller weight than this is wrong."""


def without_contradicted(
    attempts: Sequence[Attempt], loops: Sequence[Factor], poses: NDArray[np.float64]
) -> tuple[list[Attempt], list[Factor]]:
    """Take out the closures that the rest of the graph contradicts so much that they no longer pull.

    Args:
        attempts: all that were tried.
        loops: the factors of those accepted, each with its robust kernel.
        poses: (n, 3) the optimum of all factors.

    Returns:
        The attempts, those taken out marked, and the factors that stay.
    """
    if not loops:
        return list(attempts), []
    at = Problem.of(loops, len(poses)).evaluate(poses)
    gone = {
        (loop.i, loop.j): f"contradicted by the rest of the graph, {norm**0.5:.0f} standard deviations off"
        for loop, weight, norm in zip(loops, at.weights.tolist(), at.squared.tolist(), strict=True)
        if weight < _CONTRADICTED
    }
    judged = [
        replace(attempt, accepted=False, removed=True, reason=f"{why}; {attempt.reason}")
        if attempt.accepted and (why := gone.get((attempt.key_old, attempt.key_new))) is not None
        else attempt
        for attempt in attempts
    ]
    return judged, [loop for loop in loops if (loop.i, loop.j) not in gone]


def with_earlier(last: Sequence[Attempt], earlier: Sequence[Attempt]) -> list[Attempt]:
    """The record of all closures: those tried last, and those of before whose key poses were not tried again.

    Those accepted earlier are in force only if none was tried since.
    """
    if not last:
        return list(earlier)
    known = {(attempt.key_old, attempt.key_new) for attempt in last}
    gone = [a for a in earlier if not a.accepted and (a.key_old, a.key_new) not in known]
    return sorted([*gone, *last], key=lambda attempt: (attempt.key_new, attempt.key_old))


def lies_near(attempt: Attempt, T_old_new: NDArray[np.float64]) -> bool:
    """Whether a closure says what an estimate says, to within what a path is off in the ordinary course."""
    assert attempt.match is not None
    x, y, turn = between(T_old_new, attempt.match.T_ref_cur).tolist()
    return bool(x * x + y * y < _NEAR_DISTANCE**2 and abs(turn) < _NEAR_TURN)


def is_near(attempt: Attempt, poses: NDArray[np.float64]) -> bool:
    """The same of the estimate given by (n, 3) poses."""
    return lies_near(attempt, between(poses[attempt.key_old], poses[attempt.key_new]))


def say_the_same(a: Attempt, b: Attempt, poses: NDArray[np.float64]) -> bool:
    """Whether two closures agree on how the later path lies to the earlier (pairwise consistency, Mangelson 2018).

    Args:
        a: one of them.
        b: the other.
        poses: (n, 3) estimates, good between neighbouring key poses.

    Returns:
        True if going one way round the cycle or the other leads to the same place.
    """
    if a.match is None or b.match is None or a.key_new == b.key_new or abs(a.key_new - b.key_new) > _PARTNER_KEYS:
        return False
    left = compose(a.match.T_ref_cur, between(poses[a.key_new], poses[b.key_new]))
    right = compose(between(poses[a.key_old], poses[b.key_old]), b.match.T_ref_cur)
    x, y, turn = between(left, right).tolist()
    return bool(x * x + y * y < _PARTNER_DISTANCE**2 and abs(turn) < _PARTNER_TURN)


def _candidate(key_old: int, key_new: int, poses: NDArray[np.float64], deviations: NDArray[np.float64]) -> Candidate:
    T_old_new = between(poses[key_old], poses[key_new])
    return Candidate(key_old=key_old, key_new=key_new, T_old_new=T_old_new, deviations=deviations)


def _describe(support: Agreement) -> str:
    return f"overlap {support.overlap:.2f}, fit {support.fit:.2f}, view {support.view:.2f}"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reference:
    """An earlier pass, prepared for the matcher and for the judge of its matches."""

    matched: Any
    judged: LocalMap
    placed: NDArray[np.float64]


class LoopCloser:
    """Looks for earlier passes around a key pose and matches against their local maps."""

    def __init__(self, matcher: Matcher, track: Track, config: LoopClosureConfig, parts: Sequence[int] = ()) -> None:
        """Start with nothing matched.

        Args:
            matcher: ICE or any other.
            track: key scans.
            config: where passes are looked for and what is believed.
            parts: key poses at which a part of the path begins that nothing ties to what was before: how they lie to
                each other is unknown, so that no neighbours are looked for across.
        """
        self._matcher = matcher
        lost = set(track.lost)
        begins = [key.index in lost for key in track.keys]
        self._stretch = np.cumsum(begins)  # a reference holds scans of one stretch only
        self._part = np.searchsorted(np.sort(np.asarray(parts, dtype=np.int64)), np.arange(len(begins)), side="right")
        self._keys = track.keys
        self.config = config
        self._path = np.cumsum([key.motion.distance for key in track.keys])
        self._judge = matcher if isinstance(matcher, IceMatcher) else IceMatcher()
        self._references: dict[int, _Reference] = {}
        self.offered = np.ones(len(track.keys), dtype=np.bool_)
        """(n_keys,) which key scans later ones are matched against: not those that only confirm a known place."""

    def candidates(self, key_new: int, poses: NDArray[np.float64], drift: "Drift") -> list[Candidate]:
        """Earlier passes whose view overlaps that of `key_new`, nearest first.

        Args:
            key_new: the key pose.
            poses: (n, 3) current estimate of all key poses up to it.
            drift: how uncertain paths are.

        Returns:
            One candidate per pass, the key pose whose view lies nearest; after much drift, when the nearest need not be
            the right one, one for each piece of every pass.
        """
        config = self.config
        if not (config.enabled or config.revisits):
            return []
        widest = float(self._search_deviations(drift.between(0, key_new, poses))[0])
        is_adrift = widest > 2 * _NEAR_DEVIATIONS[0]
        piece = 2 * config.reference_half if is_adrift else len(poses)
        found = []
        for distance, key in self._passes(key_new, poses, config.radius + 2.0 * widest, piece):
            deviations = self._search_deviations(drift.between(key, key_new, poses))
            if distance < config.radius + 2.0 * deviations[0]:
                found.append(_candidate(key, key_new, poses, deviations))
        return found[: config.max_pieces if is_adrift else config.max_passes]

    def candidate(
        self, key_old: int, key_new: int, poses: NDArray[np.float64], deviations: NDArray[np.float64]
    ) -> Candidate:
        """Two given key poses, known to within `deviations` [m, m, rad] of each other."""
        return _candidate(key_old, key_new, poses, deviations)

    def neighbours(self, key_new: int, poses: NDArray[np.float64], deviations: NDArray[np.float64]) -> list[Candidate]:
        """The same among optimised poses, all known to within `deviations` [m, m, rad]."""
        passes = self._passes(key_new, poses, self.config.radius, len(poses))
        return [_candidate(key, key_new, poses, deviations) for _, key in passes[: self.config.max_passes]]

    def seen_from(
        self,
        key_new: int,
        T_map_new: NDArray[np.float64],
        poses: NDArray[np.float64],
        before: int,
        deviations: NDArray[np.float64],
    ) -> list[Candidate]:
        """Passes before key pose `before` around where `key_new` is supposed to be, to within `deviations`."""
        supposed = poses[: key_new + 1].copy()
        supposed[key_new] = T_map_new
        passes = [key for _, key in self._passes(key_new, supposed, self.config.radius, len(poses)) if key < before]
        return [_candidate(key, key_new, supposed, deviations) for key in passes[: self.config.max_passes]]

    def _passes(self, key_new: int, poses: NDArray[np.float64], reach: float, piece: int) -> list[tuple[float, int]]:
        """Distance of the views and key pose of each piece of an earlier pass within reach, nearest first."""
        config = self.config
        n_old = int(np.searchsorted(self._path, self._path[key_new] - config.min_path))
        old = np.flatnonzero(self.offered[:n_old] & (self._part[:n_old] == self._part[key_new]))
        far = np.hypot(*(self._views(poses[old]) - self._views(poses[key_new])).T)
        near = np.flatnonzero(far < reach)
        if not len(near):
            return []
        passes = np.split(near, np.flatnonzero(np.diff(old[near]) > config.pass_gap) + 1)
        pieces = [part for p in passes for part in np.array_split(p, -(-len(p) // piece))]
        nearest = [int(p[far[p].argmin()]) for p in pieces]
        return sorted((float(far[k]), self._anchor(int(old[k]), key_new)) for k in nearest)

    def _views(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 2) what key poses look at."""
        ahead = np.stack([np.cos(poses[..., 2]), np.sin(poses[..., 2])], axis=-1)
        return poses[..., :2] + self.config.view_distance * ahead

    def _anchor(self, key: int, key_new: int) -> int:
        """The key pose whose frame a reference around `key` has: neighbours share one, so that it is built once."""
        anchor = ANCHOR_SPACING * round(key / ANCHOR_SPACING)
        return anchor if anchor < key_new else key

    def match(self, candidate: Candidate, poses: NDArray[np.float64]) -> Attempt:
        """Match a key scan against the local map of a candidate's pass and verify it with its neighbours.

        First close to the estimate; only if nothing fits there, and the drift allows more, in the whole window, where
        a closure must also be the only one that fits.
        """
        reference = self._reference(candidate.key_old, poses)
        near = np.minimum(candidate.deviations, _NEAR_DEVIATIONS)
        attempt = self._match_at(reference, candidate, candidate.T_old_new, near)
        if attempt.accepted or candidate.deviations[0] <= _NEAR_DEVIATIONS[0]:
            return attempt
        return self._match_wide(reference, candidate) or attempt

    def match_anywhere(self, key_old: int, key_new: int, poses: NDArray[np.float64]) -> Attempt:
        """Match two key scans whose places look alike, whatever the poses say: metres off, any heading.

        The pose must be the only one that fits there.
        """
        here = Candidate(key_old=key_old, key_new=key_new, T_old_new=np.zeros(3), deviations=_ANYWHERE_DEVIATIONS)
        nothing = Attempt(key_old=key_old, key_new=key_new, match=None, accepted=False, reason="nothing fits")
        return self._match_wide(self._reference(key_old, poses), here) or nothing

    @property
    def judge(self) -> IceMatcher:
        """The matcher that verifies."""
        return self._judge

    def _match_at(
        self,
        reference: _Reference,
        candidate: Candidate,
        T_old_guess: NDArray[np.float64],
        deviations: NDArray[np.float64],
    ) -> Attempt:
        attempt = Attempt(key_old=candidate.key_old, key_new=candidate.key_new, match=None, accepted=False, reason="")
        scan = self._keys[candidate.key_new].scan
        found = self._matcher.match(reference.matched, scan, T_old_guess, np.diag(deviations**2))
        if isinstance(found, NoMatch):
            return replace(attempt, reason=found.reason)
        support = self._support(reference, candidate.key_new, found.T_ref_cur)
        return replace(
            attempt,
            match=replace(found, covariance=found.covariance * self.config.covariance_factor),
            accepted=self._is_supported(support),
            reason=_describe(support),
            overlap=support.overlap,
        )

    def _match_wide(self, reference: _Reference, candidate: Candidate) -> Attempt | None:
        if not isinstance(self._matcher, MapMatcher):
            return None
        scan = self._keys[candidate.key_new].scan
        found = self._matcher.alternatives(
            reference.matched, scan, candidate.T_old_new, np.diag(candidate.deviations**2)
        )
        fitting = [T for T in found if self._is_supported(self._support(reference, candidate.key_new, T))]
        if not fitting:
            return None
        attempt = self._match_at(reference, candidate, fitting[0], _EXACT_DEVIATIONS)
        if len(fitting) > 1:
            return replace(attempt, accepted=False, reason=f"{len(fitting)} places fit; {attempt.reason}")
        return attempt

    def _search_deviations(self, drift: NDArray[np.float64]) -> NDArray[np.float64]:
        """Standard deviations [m, m, rad] of a search, from those of the path."""
        config = self.config
        most = config.max_drift if config.enabled else config.revisit_drift
        position = min(most, config.drift_factor * float(drift[0]) + config.drift_floor)
        heading = min(config.max_turn, config.drift_factor * float(drift[1]) + config.turn_floor)
        return np.array([position, position, heading])

    def _is_supported(self, support: Agreement) -> bool:
        config = self.config
        return (
            support.overlap >= config.min_overlap and support.fit >= config.min_fit and support.view >= config.min_view
        )

    def _reference(self, base: int, poses: NDArray[np.float64]) -> _Reference:
        """Local map of the key scans of one pass around `base`, in the frame of `base`."""
        half = self.config.reference_half
        members = np.arange(max(0, base - half), min(len(poses), base + half + 1))
        members = members[self._stretch[members] == self._stretch[base]]
        placed = between(poses[base], poses[members])
        kept = self._references.get(base)
        if kept is not None and len(kept.placed) == len(placed) and np.abs(kept.placed - placed).max() < _STILL:
            return kept
        nearest_last = np.argsort(-np.abs(members - base), kind="stable")
        scans, poses_ref = [self._keys[members[k]].scan for k in nearest_last], placed[nearest_last]
        matched = self._matcher.prepare(scans, poses_ref)
        judged = matched if self._judge is self._matcher else self._judge.prepare(scans, poses_ref)
        if len(self._references) >= _REFERENCES_KEPT:
            del self._references[next(iter(self._references))]
        self._references[base] = _Reference(matched=matched, judged=judged, placed=placed)
        return self._references[base]

    def _support(self, reference: _Reference, key_new: int, T_ref_new: NDArray[np.float64]) -> Agreement:
        """How a key scan and its neighbours agree with the reference at the poses a closure implies for them."""
        total = Agreement()
        for offset in self.config.support_offsets:
            other = key_new + offset
            if 0 <= other < len(self._keys) and self._stretch[other] == self._stretch[key_new]:
                T_new_other = between(self._keys[key_new].T_track_robot, self._keys[other].T_track_robot)
                T_ref_other = compose(T_ref_new, T_new_other)
                total += self._judge.agreement(reference.judged, self._keys[other].scan, T_ref_other)
        return total
