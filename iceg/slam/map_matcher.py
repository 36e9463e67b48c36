"""What the pipeline asks of a matcher: maps that grow, scans followed quickly, places that can be verified."""

from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from frontends.matcher import Matcher
from frontends.scan import Scan, ScanGeometry
from graph.arrays import Float32s, Floats
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.ice.tracking import Followed, Limits, Standing
from iceg.ice.verification import Agreement

Prepared: TypeAlias = Any
"""A local map as a matcher has prepared it: whatever its `prepare` returned."""
NEAR = np.diag([0.05, 0.05, 0.02]) ** 2
"""Covariance of a guess that a match must not leave far [m², m², rad²]."""


@runtime_checkable
class MapMatcher(Matcher, Protocol):
    """`IceMatcher` is one; `completed` makes one of any matcher."""

    @property
    def judge(self) -> IceMatcher:
        """Who says whether scans belong where the matches put them."""
        ...

    def judged(self, reference: Prepared) -> LocalMap:
        """What the judge compares with, of a reference."""
        ...

    def track(self, reference: Prepared, scan: Scan, T_ref_guess: Floats, covariance_guess: Floats) -> Floats | NoMatch:
        """As `match`, but only the (3,) pose, for the scans between two key scans."""
        ...

    def extend(self, reference: Prepared, scan: Scan, T_ref_scan: Floats) -> None:
        """Add one more scan to a reference, at the (3,) pose given."""
        ...

    def agreement(self, reference: Prepared, scan: Scan, T_ref_cur: Floats) -> Agreement:
        """Compare a scan with a reference at a given (3,) pose, in both directions."""
        ...

    def position_information(self, reference: Prepared, scan: Scan, T_ref_cur: Floats) -> Floats:
        """(2, 2) how well a scan measures its position at a (3,) pose, in the robot's frame [1/m²], not its heading."""
        ...

    def last_seen(self, reference: Prepared, scan: Scan, T_ref_cur: Floats) -> Floats:
        """(m, 3, 3) what a scan tells of its (3,) pose by what each of the newest m scans was the last to see."""
        ...

    def match_near(self, reference: Prepared, scan: Scan, T_ref_guess: Floats) -> RelativePose | NoMatch:
        """The match nearest to a (3,) guess that is right but for centimetres: along what is weak it stays there."""
        ...

    def alternatives(
        self, reference: Prepared, scan: Scan, T_ref_guess: Floats, covariance_guess: Floats
    ) -> list[Floats]:
        """Distinct (3,) poses around the guess that fit, the best first: with several the place is ambiguous."""
        ...

    def follow(
        self,
        reference: Prepared,
        ranges: Float32s,
        steps: Floats,
        geometry: ScanGeometry,
        standing: Standing,
        odometry: OdometryModel,
        limits: Limits,
    ) -> Followed:
        """As `track` for scan after scan, perhaps for none; see `iceg.ice.tracking.follow_scans`."""
        ...
