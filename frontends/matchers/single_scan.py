"""The matchers of one scan against one other, both in bearing order."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _bearing_kernels as kernels
from frontends.matchers.acceptance import AcceptanceConfig
from frontends.matchers.bearing_scan import BearingScan
from frontends.matchers.point_matcher import PointMatcher
from frontends.scan import Scan


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceScan:
    """The scan that is matched against, in the frame of its laser.

    Attributes:
        points: its returns.
        linked: (n,) which neighbouring returns are joined by a piece of surface.
        T_ref_laser: (3,) its laser in the reference frame of the caller.
    """

    points: BearingScan
    linked: NDArray[np.bool_]
    T_ref_laser: NDArray[np.float64]

    def __len__(self) -> int:
        """Number of returns."""
        return len(self.points)


class SingleScanMatcher(PointMatcher[ReferenceScan, BearingScan]):
    """Matches against the newest scan of the reference; the older ones are left out."""

    def __init__(self, acceptance: AcceptanceConfig, max_gap: float) -> None:
        """Join neighbouring returns nearer than `max_gap` [m] by a piece of surface."""
        super().__init__(acceptance)
        self._max_gap = max_gap

    def _extract(self, scan: Scan) -> BearingScan:
        return BearingScan.of(scan)

    def _place(self, scans: list[Scan], T_ref_lasers: NDArray[np.float64]) -> ReferenceScan:
        points = self._points_of(scans[-1])
        return ReferenceScan(points=points, linked=points.links(self._max_gap), T_ref_laser=T_ref_lasers[-1])

    def _agreeing(
        self, reference: ReferenceScan, points: BearingScan, T_frame_laser: NDArray[np.float64]
    ) -> tuple[int, int]:
        inliers, known = kernels.agreement(
            reference.points.xy,
            reference.points.bearings,
            reference.linked,
            points.xy,
            T_frame_laser,
            self._acceptance.inlier_distance,
            self._acceptance.known_distance,
        )
        return int(inliers), int(known)
