"""Candidates matched and judged: a closure must fit its scan and the neighbours of its scan.

A match alone cannot be believed: along a corridor much fits anywhere. So the scans before and after must agree with
the earlier pass, too, at the poses that the closure implies for them, and a search that is wide must find one place
only.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from graph.arrays import Floats
from graph.measurement import NoMatch
from graph.se2 import between, compose
from iceg.ice.verification import Agreement, JoinedScans
from iceg.slam.closures.attempt import Attempt, Place, unmatched
from iceg.slam.closures.candidates import Candidate
from iceg.slam.closures.reference import Reference, References
from iceg.slam.config import LoopClosureConfig
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.match_errors import closure_covariance, placement_covariance
from iceg.slam.track import Track

_REMEMBERED = 50
"""Key scans whose neighbours are kept joined."""


class ClosureVerifier:
    """Matches key scans against earlier passes and says which matches are believed."""

    def __init__(self, matcher: MapMatcher, track: Track, config: LoopClosureConfig) -> None:
        self._matcher = matcher
        self._track = track
        self._keys = track.keys
        self._config = config
        self._judge = matcher.judge
        self._neighbours: dict[int, tuple[JoinedScans, Floats] | None] = {}
        self._references = References(matcher, track, config.reference_half)

    def match(self, candidate: Candidate, poses: Floats) -> Attempt:
        """See `LoopCloser.match`; after much drift what fits close to the estimate is preferred, if not alone."""
        reference = self._references.around(candidate.key_old, poses)
        trusted = self._config.verification.trusted
        if candidate.deviations[0] > self._config.verification.uncertain_distance:
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
        trusted = self._config.verification.trusted.deviations
        attempt = self._match_at(reference, replace(candidate, deviations=trusted))
        if attempt.match is None or not attempt.accepted:
            return wide
        here = self._places(reference, candidate.key_new, [attempt.match.T_ref_cur])
        return replace(attempt, places=(*here, *wide.places))

    def match_anywhere(self, key_old: int, key_new: int, poses: Floats) -> Attempt:
        """Match two key scans metres off and at any heading; neighbours lie to each other as (n, 3) poses say."""
        deviations = self._config.verification.anywhere.deviations
        here = Candidate(key_old=key_old, key_new=key_new, T_old_new=np.zeros(3), deviations=deviations)
        return self._match_wide(self._references.around(key_old, poses), here)

    def _match_at(self, reference: Reference, candidate: Candidate) -> Attempt:
        """Match once, around a guess."""
        old, new = candidate.pair
        guess, covariance = candidate.T_old_new, np.diag(candidate.deviations**2)
        found = self._matcher.match(reference.matched, self._keys[new].scan, guess, covariance)
        if isinstance(found, NoMatch):
            return unmatched(old, new, found.reason)
        (support,) = self._supports(reference, new, found.T_ref_cur[None])
        placement = placement_covariance(self._track, old)
        return Attempt(
            key_old=old,
            key_new=new,
            match=replace(found, covariance=closure_covariance(found, placement, self._track.match_covariance_scale)),
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
        refined = self._config.verification.refined.deviations
        there = replace(candidate, T_old_new=fitting[0].T_old_new, deviations=refined)
        attempt = self._match_at(reference, there)
        attempt = replace(attempt, places=tuple(fitting))
        if len(fitting) > 1:
            return replace(attempt, accepted=False, reason=f"{len(fitting)} places fit; {attempt.reason}")
        return attempt

    def _places(self, reference: Reference, key_new: int, found: Sequence[Floats]) -> list[Place]:
        """Where a key scan and its neighbours fit, of several poses of it; the best first."""
        if not found:
            return []
        config = self._config
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
        return self._judge.agreements(reference.judged, scans, placements, least_overlap, least_fit)

    def _neighbours_of(self, key_new: int) -> tuple[JoinedScans, Floats] | None:
        """A key scan and its neighbours, and their (m, 3) poses in its frame; None where none is asked.

        Joined once, since several passes are tried.
        """
        if key_new in self._neighbours:
            return self._neighbours[key_new]
        asked = [key_new + offset for offset in self._config.support_offsets]
        asked = [key for key in asked if 0 <= key < len(self._keys) and self._references.is_one_pass(key, key_new)]
        found = None
        if asked:
            T_track_asked = np.array([self._keys[key].T_track_robot for key in asked])
            T_new_scans = between(self._keys[key_new].T_track_robot, T_track_asked)
            found = self._judge.join([self._keys[key].scan for key in asked]), T_new_scans
        if len(self._neighbours) >= _REMEMBERED:
            del self._neighbours[next(iter(self._neighbours))]
        self._neighbours[key_new] = found
        return found

    def _is_supported(self, support: Agreement) -> bool:
        config = self._config
        return (
            support.overlap >= config.min_overlap and support.fit >= config.min_fit and support.view >= config.min_view
        )
