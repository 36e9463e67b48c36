"""Any matcher in the pipeline: what it does not do itself is made of its matches, and judged by ICE."""

from dataclasses import dataclass, replace

import numpy as np

from frontends.matcher import Matcher
from frontends.scan import Scan, ScanGeometry
from graph.arrays import Float32s, Floats
from graph.measurement import NoMatch, RelativePose
from graph.noise import chi2_gate, squared_norm
from graph.odometry import OdometryModel
from graph.se2 import between
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.ice.tracking import Followed, Limits, Standing
from iceg.ice.verification import Agreement
from iceg.slam.map_matcher import NEAR, MapMatcher, Prepared

_LEFT = chi2_gate(0.05)
"""Squared Mahalanobis distance from which on a match has left what the judge finds near a guess."""


@dataclass(slots=True, kw_only=True)
class JudgedReference:
    """A reference of any matcher, and the same scans for the judge.

    Attributes:
        scans: oldest first.
        T_ref_scans: their poses, (3,) each.
        matched: what the matcher made of them.
        local_map: what the judge did.
    """

    scans: list[Scan]
    T_ref_scans: list[Floats]
    matched: Prepared
    local_map: LocalMap


class CompletedMatcher:
    """A matcher of two methods with all that `MapMatcher` asks: to be overridden by what is quicker or better.

    Scans are tracked by full matches; a reference is extended by preparing it again; ICE says how well a scan agrees,
    where else it fits, and where it fits near a guess that the matcher slides away from.
    """

    def __init__(self, matcher: Matcher, judge: IceMatcher | None = None) -> None:
        """Complete a matcher; ICE with its defaults judges unless another is given."""
        self._matcher = matcher
        self.judge = judge or IceMatcher()
        """See `MapMatcher`."""

    def judged(self, reference: JudgedReference) -> LocalMap:
        """See `MapMatcher`."""
        return reference.local_map

    def prepare(self, scans: list[Scan], T_ref_scans: Floats) -> JudgedReference:
        """The matcher's reference, and the judge's."""
        return JudgedReference(
            scans=list(scans),
            T_ref_scans=list(T_ref_scans),
            matched=self._matcher.prepare(scans, T_ref_scans),
            local_map=self.judge.prepare(scans, T_ref_scans),
        )

    def match(
        self, reference: JudgedReference, scan: Scan, T_ref_guess: Floats, covariance_guess: Floats
    ) -> RelativePose | NoMatch:
        """The matcher's own."""
        return self._matcher.match(reference.matched, scan, T_ref_guess, covariance_guess)

    def track(
        self, reference: JudgedReference, scan: Scan, T_ref_guess: Floats, covariance_guess: Floats
    ) -> Floats | NoMatch:
        """Where it matches."""
        match = self.match(reference, scan, T_ref_guess, covariance_guess)
        return match if isinstance(match, NoMatch) else match.T_ref_cur

    def extend(self, reference: JudgedReference, scan: Scan, T_ref_scan: Floats) -> None:
        """All scans prepared again with one more."""
        reference.scans.append(scan)
        reference.T_ref_scans.append(T_ref_scan)
        reference.matched = self._matcher.prepare(list(reference.scans), np.array(reference.T_ref_scans))
        self.judge.extend(reference.local_map, scan, T_ref_scan)

    def agreement(self, reference: JudgedReference, scan: Scan, T_ref_cur: Floats) -> Agreement:
        """What the judge says."""
        return self.judge.agreement(reference.local_map, scan, T_ref_cur)

    def position_information(self, reference: JudgedReference, scan: Scan, T_ref_cur: Floats) -> Floats:
        """What the judge says."""
        return self.judge.position_information(reference.local_map, scan, T_ref_cur)

    def last_seen(self, reference: JudgedReference, scan: Scan, T_ref_cur: Floats) -> Floats:
        """What the judge says."""
        return self.judge.last_seen(reference.local_map, scan, T_ref_cur)

    def match_near(self, reference: JudgedReference, scan: Scan, T_ref_guess: Floats) -> RelativePose | NoMatch:
        """The match begun where the judge finds the scan near the guess; if it leaves that, what the judge finds.

        Most matchers take no prior: along what is weak they do not stay at the guess but slide. The judge's pose is
        known to centimetres only: it keeps the scan from where it is not, and leaves the rest to odometry.
        """
        held = self.judge.match_near(reference.local_map, scan, T_ref_guess)
        if isinstance(held, NoMatch):
            return held
        match = self.match(reference, scan, held.T_ref_cur, NEAR)
        if isinstance(match, NoMatch) or squared_norm(between(held.T_ref_cur, match.T_ref_cur), NEAR) > _LEFT:
            return replace(held, covariance=held.covariance + NEAR)
        return match

    def alternatives(
        self, reference: JudgedReference, scan: Scan, T_ref_guess: Floats, covariance_guess: Floats
    ) -> list[Floats]:
        """Where the judge finds that it fits."""
        return self.judge.alternatives(reference.local_map, scan, T_ref_guess, covariance_guess)

    def follow(
        self,
        reference: JudgedReference,  # noqa: ARG002
        ranges: Float32s,  # noqa: ARG002
        steps: Floats,  # noqa: ARG002
        geometry: ScanGeometry,  # noqa: ARG002
        standing: Standing,
        odometry: OdometryModel,  # noqa: ARG002
        limits: Limits,  # noqa: ARG002
    ) -> Followed:
        """None: each scan is tracked by itself."""
        return Followed(T_ref_robots=np.empty((0, 3)), motion=standing.motion, key_scan=None)


def completed(matcher: Matcher, judge: IceMatcher | None = None) -> MapMatcher:
    """Any matcher as the pipeline wants it; one that does all of it already stays.

    Args:
        matcher: ICE or any other.
        judge: of the matches of another; ICE with its defaults when left out.
    """
    return matcher if isinstance(matcher, MapMatcher) else CompletedMatcher(matcher, judge)
