"""Places seen again: where to look for them, and what to believe of what is found there.

The back end on the way, the finish afterwards and the search for lost places ask the same two questions of a
`LoopCloser`: which earlier passes may see what a key scan sees, and does it match there? A match alone cannot be
believed: along a corridor much fits anywhere. So the scans before and after must agree with the earlier pass, too, at
the poses that the closure implies for them, and a search that is wide must find one place only.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from graph.arrays import Floats
from graph.measurement import NoMatch
from graph.se2 import between, compose
from iceg.ice.verification import Agreement, JoinedScans
from iceg.slam.closures.attempt import FORBIDDEN, Attempt, Place, unmatched
from iceg.slam.closures.candidates import Candidate, EarlierPasses
from iceg.slam.closures.reference import Reference, References
from iceg.slam.config import LoopClosureConfig
from iceg.slam.drift import Drift
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.match_errors import closure_covariance, placement_covariance
from iceg.slam.stages import IN_HOUSE, Stages, checked_candidates
from iceg.slam.track import Track

Forbids = Callable[[int, int], bool]
"""Whether a closure between an earlier and a later key pose must not be."""
_REMEMBERED = 50
"""Key scans whose neighbours are kept joined."""


class LoopCloser:
    """Looks for earlier passes around a key pose and matches against their local maps."""

    def __init__(
        self,
        matcher: MapMatcher,
        track: Track,
        config: LoopClosureConfig,
        parts: Sequence[int] = (),
        is_forbidden: Forbids | None = None,
        stages: Stages = IN_HOUSE,
    ) -> None:
        """Start with nothing matched.

        Args:
            matcher: ICE or any other.
            track: key scans.
            config: where passes are looked for and what is believed.
            parts: key poses at which a part of the path begins that nothing ties to what was before: how they lie to
                each other is unknown, so that no neighbours are looked for across.
            is_forbidden: whether a closure between an earlier and a later key pose must not be; None for none.
            stages: candidates and verification of the caller's own.
        """
        self.config = config
        self.track = track
        self._matcher = matcher
        self._keys = track.keys
        self._stages = stages
        self.judge = matcher.judge
        """The matcher that verifies."""
        self.passes = EarlierPasses(track, config, parts)
        """Where to look."""
        self._is_forbidden = is_forbidden
        self._references = References(matcher, track, config.reference_half)
        self._neighbours: dict[int, tuple[JoinedScans, Floats] | None] = {}

    def candidates(self, key_new: int, poses: Floats, drift: Drift) -> list[Candidate]:
        """Earlier passes whose view overlaps that of `key_new`, nearest first.

        Args:
            key_new: the key pose.
            poses: (n, 3) current estimate of all key poses up to it.
            drift: how uncertain paths are.

        Returns:
            One candidate per pass, the key pose whose view lies nearest; after much drift, when the nearest need not be
            the right one, one for each piece of every pass.
        """
        if self._stages.candidates is not None:
            own = self._stages.candidates(key_new, self._keys[: key_new + 1], poses)
            return checked_candidates(own, key_new)
        return self.passes.within_drift(key_new, poses, drift)

    def match(self, candidate: Candidate, poses: Floats) -> Attempt:
        """Match a key scan against the local map of a candidate's pass and verify it with its neighbours.

        First close to the estimate; if nothing fits there, and the drift allows more, in the whole window, where a
        closure must also be the only one that fits. After much drift in the whole window at once.

        Args:
            candidate: the two key poses.
            poses: (n, 3) T_map_robot of all up to the later, good between neighbours.
        """
        return self._attempted(candidate, poses, self._match_around)

    def match_anywhere(self, key_old: int, key_new: int, poses: Floats) -> Attempt:
        """Match two key scans that somebody says are of one place, whatever the poses say: metres off, turned by much.

        The pose must be the only one that fits there.

        Args:
            key_old: the earlier.
            key_new: the later.
            poses: (n, 3) T_map_robot, good between neighbours.
        """
        deviations = self.config.verification.anywhere.deviations
        here = Candidate(key_old=key_old, key_new=key_new, T_old_new=np.zeros(3), deviations=deviations)
        return self._attempted(here, poses, self._match_wide)

    def _attempted(
        self, candidate: Candidate, poses: Floats, match: Callable[[Reference, Candidate], Attempt]
    ) -> Attempt:
        """What a match finds, unless that is forbidden; with the caller's verdict, where there is one."""
        if self._is_forbidden is not None and self._is_forbidden(*candidate.pair):
            return unmatched(*candidate.pair, FORBIDDEN)
        attempt = match(self._references.around(candidate.key_old, poses), candidate)
        if self._stages.verification is None or attempt.match is None:
            return attempt
        return self._stages.verification(attempt, self._keys[: attempt.key_new + 1], poses)

    def _match_around(self, reference: Reference, candidate: Candidate) -> Attempt:
        """See `match`; of several places that fit after much drift, the one close to the estimate is preferred."""
        trusted = self.config.verification.trusted
        if candidate.deviations[0] > self.config.verification.uncertain_distance:
            return self._nearest(reference, candidate, self._match_wide(reference, candidate))
        near = np.minimum(candidate.deviations, trusted.deviations)
        attempt = self._match_at(reference, replace(candidate, deviations=near))
        if candidate.deviations[0] <= trusted.distance or attempt.accepted:
            return attempt
        wide = self._match_wide(reference, candidate)
        return attempt if wide.match is None else wide

    def _nearest(self, reference: Reference, candidate: Candidate, wide: Attempt) -> Attempt:
        """What a wide search found; where that is several places, the one close to the estimate, if it is one."""
        if not wide.is_ambiguous:
            return wide
        trusted = self.config.verification.trusted.deviations
        attempt = self._match_at(reference, replace(candidate, deviations=trusted))
        if attempt.match is None or not attempt.accepted:
            return wide
        here = self._places(reference, candidate.key_new, [attempt.match.T_ref_cur])
        return replace(attempt, places=(*here, *wide.places))

    def _match_at(self, reference: Reference, candidate: Candidate) -> Attempt:
        """Match once, around a guess."""
        old, new = candidate.pair
        guess, covariance = candidate.T_old_new, np.diag(candidate.deviations**2)
        found = self._matcher.match(reference.matched, self._keys[new].scan, guess, covariance)
        if isinstance(found, NoMatch):
            return unmatched(old, new, found.reason)
        (support,) = self._supports(reference, new, found.T_ref_cur[None])
        placement = placement_covariance(self.track, old)
        return Attempt(
            key_old=old,
            key_new=new,
            match=replace(found, covariance=closure_covariance(found, placement, self.track.match_covariance_scale)),
            accepted=self._is_supported(support),
            reason=f"overlap {support.overlap:.2f}, fit {support.fit:.2f}, view {support.view:.2f}",
            overlap=support.overlap,
        )

    def _match_wide(self, reference: Reference, candidate: Candidate) -> Attempt:
        """Match in the whole window; what fits in several places is not believed in any."""
        scan = self._keys[candidate.key_new].scan
        found = self._matcher.alternatives(
            reference.matched, scan, candidate.T_old_new, np.diag(candidate.deviations**2)
        )
        fitting = self._places(reference, candidate.key_new, found)
        if not fitting:
            return unmatched(*candidate.pair, "nothing fits")
        refined = self.config.verification.refined.deviations
        there = replace(candidate, T_old_new=fitting[0].T_old_new, deviations=refined)
        attempt = replace(self._match_at(reference, there), places=tuple(fitting))
        return attempt.judged(f"{len(fitting)} places fit") if len(fitting) > 1 else attempt

    def _places(self, reference: Reference, key_new: int, found: Sequence[Floats]) -> list[Place]:
        """Where a key scan and its neighbours fit, of several poses of it; the best first."""
        if not found:
            return []
        config = self.config
        supports = self._supports(reference, key_new, np.array(found), config.min_overlap, config.min_fit)
        places = [
            Place(T_old_new=T_ref_new, misfit=2.0 - support.fit - support.view)
            for T_ref_new, support in zip(found, supports, strict=True)
            if self._is_supported(support)
        ]
        return sorted(places, key=lambda place: place.misfit)

    def _supports(
        self, reference: Reference, key_new: int, T_ref_news: Floats, least_overlap: float = 0.0, least_fit: float = 0.0
    ) -> list[Agreement]:
        """How a key scan and its neighbours agree with the reference where each of (p, 3) poses of it puts them.

        The view is looked at only of those that reach the least overlap and fit.
        """
        neighbours = self._neighbours_of(key_new)
        if neighbours is None:
            return [Agreement()] * len(T_ref_news)
        scans, T_new_scans = neighbours
        placements = compose(T_ref_news[:, None], T_new_scans)
        return self.judge.agreements(reference.judged, scans, placements, least_overlap, least_fit)

    def _neighbours_of(self, key_new: int) -> tuple[JoinedScans, Floats] | None:
        """A key scan and its neighbours, and their (m, 3) poses in its frame; None where none is asked.

        Joined once, since several passes are tried.
        """
        if key_new in self._neighbours:
            return self._neighbours[key_new]
        asked = [key_new + offset for offset in self.config.support_offsets]
        asked = [key for key in asked if 0 <= key < len(self._keys) and self._references.is_one_pass(key, key_new)]
        found = None
        if asked:
            T_track_asked = np.array([self._keys[key].T_track_robot for key in asked])
            T_new_scans = between(self._keys[key_new].T_track_robot, T_track_asked)
            found = self.judge.join([self._keys[key].scan for key in asked]), T_new_scans
        if len(self._neighbours) >= _REMEMBERED:
            del self._neighbours[next(iter(self._neighbours))]
        self._neighbours[key_new] = found
        return found

    def _is_supported(self, support: Agreement) -> bool:
        config = self.config
        return (
            support.overlap >= config.min_overlap and support.fit >= config.min_fit and support.view >= config.min_view
        )
