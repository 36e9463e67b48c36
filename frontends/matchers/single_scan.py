"""What the matchers of one scan against one other share: frames, acceptance, covariance, agreement."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _bearing_kernels as kernels
from frontends.matchers.acceptance import AcceptanceConfig, Alignment, objection, tangent_covariance
from frontends.matchers.bearing_scan import BearingScan
from frontends.matchers.errors import MatcherError
from frontends.scan import Scan
from graph.measurement import NoMatch, RelativePose
from graph.se2 import between, compose, inverse

_FEWEST_POINTS = 10


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


class SingleScanMatcher(ABC):
    """Matches against the newest scan of the reference (implements `Matcher` but for the iterations themselves)."""

    def __init__(self, acceptance: AcceptanceConfig, max_gap: float) -> None:
        """Keep the points of each scan for as long as the scan lives.

        Args:
            acceptance: when a match is credible.
            max_gap: neighbouring returns nearer than this are joined by a piece of surface [m].
        """
        self._acceptance = acceptance
        self._max_gap = max_gap
        self._points: WeakKeyDictionary[Scan, BearingScan] = WeakKeyDictionary()

    @abstractmethod
    def _align(
        self, reference: ReferenceScan, points: BearingScan, T_frame_guess: NDArray[np.float64]
    ) -> Alignment:
        """The paper's iterations from a guess, laser frame against laser frame."""

    def prepare(self, scans: list[Scan], T_ref_scans: NDArray[np.float64]) -> ReferenceScan:
        """Take the newest of the scans, (n, 3) poses in one frame, as the reference."""
        if not scans:
            raise MatcherError("a reference needs at least one scan, found none")
        points = self._points_of(scans[-1])
        return ReferenceScan(
            points=points,
            linked=points.links(self._max_gap),
            T_ref_laser=compose(T_ref_scans[-1], scans[-1].geometry.T_robot_laser),
        )

    def match(
        self,
        reference: ReferenceScan,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        """Find the robot pose of `scan` in the frame of the reference, see `frontends.matcher.Matcher`."""
        points = self._points_of(scan)
        for name, returns in (("reference", reference.points), ("scan", points)):
            if len(returns) < _FEWEST_POINTS:
                return NoMatch(reason=f"only {len(returns)} beams of the {name} returned")
        T_robot_laser = scan.geometry.T_robot_laser
        T_frame_guess = between(reference.T_ref_laser, compose(T_ref_guess, T_robot_laser))
        found = self._align(reference, points, T_frame_guess)
        refused = objection(found, len(points), T_frame_guess, covariance_guess, self._acceptance)
        if refused is not None:
            return refused
        inliers, known = self._agreeing(reference, points, found.T_frame_laser)
        if inliers < self._acceptance.min_inliers * len(points):
            return NoMatch(reason=f"only {inliers / len(points):.0%} of the beams agree with the reference")
        covariance, weak_directions = tangent_covariance(found, T_robot_laser, self._acceptance)
        return RelativePose(
            T_ref_cur=compose(reference.T_ref_laser, compose(found.T_frame_laser, inverse(T_robot_laser))),
            covariance=covariance,
            score=inliers / len(points),
            inliers=inliers,
            overlap=known / len(points),
            weak_directions=weak_directions,
        )

    def agreement(self, reference: ReferenceScan, scan: Scan, T_ref_cur: NDArray[np.float64]) -> float:
        """Share of a scan's beams that agree with the reference at a given robot pose, in [0, 1]."""
        points = self._points_of(scan)
        if not len(points) or not len(reference.points):
            return 0.0
        T_frame_laser = between(reference.T_ref_laser, compose(T_ref_cur, scan.geometry.T_robot_laser))
        return self._agreeing(reference, points, T_frame_laser)[0] / len(points)

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

    def _points_of(self, scan: Scan) -> BearingScan:
        points = self._points.get(scan)
        if points is None:
            points = self._points[scan] = BearingScan.of(scan)
        return points
