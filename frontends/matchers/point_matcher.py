"""What all point matchers share: frames, acceptance, covariance, agreement."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from frontends.matchers.acceptance import AcceptanceConfig, Alignment, objection, tangent_covariance
from frontends.matchers.errors import require
from frontends.matchers.restarts import other_starts
from frontends.scan import Scan
from graph.measurement import NoMatch, RelativePose
from graph.se2 import between, compose, inverse

_FEWEST_POINTS = 10
"""Fewest returns of either scan."""


class PlacedPoints(Protocol):
    """A reference: some points in the frame of the newest laser."""

    @property
    def T_ref_laser(self) -> NDArray[np.float64]:
        """(3,) that laser in the reference frame of the caller."""
        ...

    def __len__(self) -> int:
        """Number of points."""
        ...


class SomePoints(Protocol):
    """What is extracted from a scan."""

    def __len__(self) -> int:
        """Number of points."""
        ...


Reference = TypeVar("Reference", bound=PlacedPoints)
Points = TypeVar("Points", bound=SomePoints)


class PointMatcher(ABC, Generic[Reference, Points]):
    """Implements `frontends.matcher.Matcher` but for what is extracted, prepared and iterated."""

    def __init__(self, acceptance: AcceptanceConfig) -> None:
        """Remember what was extracted from each scan for as long as the scan lives."""
        self._acceptance = acceptance
        self._extracted: WeakKeyDictionary[Scan, Points] = WeakKeyDictionary()

    @abstractmethod
    def _extract(self, scan: Scan) -> Points:
        """The points of a scan in the frame of its laser."""

    @abstractmethod
    def _place(self, scans: list[Scan], T_ref_lasers: NDArray[np.float64]) -> Reference:
        """The reference made of scans, at least one, with (n, 3) poses of their lasers."""

    @abstractmethod
    def _align(self, reference: Reference, points: Points, T_frame_guess: NDArray[np.float64]) -> Alignment:
        """The paper's iterations from a guess, laser against the frame of the reference."""

    @abstractmethod
    def _agreeing(self, reference: Reference, points: Points, T_frame_laser: NDArray[np.float64]) -> tuple[int, int]:
        """How many points agree with the reference at a pose, and how many fall on known reference."""

    def prepare(self, scans: list[Scan], T_ref_scans: NDArray[np.float64]) -> Reference:
        """Build the reference from scans, oldest first, and their (n, 3) robot poses in one frame."""
        require(len(scans) > 0, "a reference needs at least one scan, found none")
        mounts = np.array([scan.geometry.T_robot_laser for scan in scans])
        return self._place(scans, compose(np.asarray(T_ref_scans).reshape(-1, 3), mounts))

    def match(
        self,
        reference: Reference,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        """Find the robot pose of `scan` in the frame of the reference, see `frontends.matcher.Matcher`."""
        points = self._points_of(scan)
        for name, count in (("reference", len(reference)), ("scan", len(points))):
            if count < _FEWEST_POINTS:
                return NoMatch(reason=f"only {count} beams of the {name} returned")
        T_robot_laser = scan.geometry.T_robot_laser
        T_frame_guess = between(reference.T_ref_laser, compose(T_ref_guess, T_robot_laser))
        found = self._best_attempt(reference, points, T_frame_guess, covariance_guess)
        if isinstance(found, NoMatch):
            return found
        covariance, weak_directions = tangent_covariance(found.alignment, T_robot_laser, self._acceptance)
        T_frame_robot = compose(found.alignment.T_frame_laser, inverse(T_robot_laser))
        return RelativePose(
            T_ref_cur=compose(reference.T_ref_laser, T_frame_robot),
            covariance=covariance,
            score=found.inliers / len(points),
            inliers=found.inliers,
            overlap=found.known / len(points),
            weak_directions=weak_directions,
        )

    def _best_attempt(
        self,
        reference: Reference,
        points: Points,
        T_frame_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> "_Attempt | NoMatch":
        """From the guess and, where that ends badly, from other starts around it."""

        def attempt(start: NDArray[np.float64]) -> _Attempt | NoMatch:
            found = self._align(reference, points, start)
            refused = objection(found, len(points), T_frame_guess, covariance_guess, self._acceptance)
            if refused is not None:
                return refused
            inliers, known = self._agreeing(reference, points, found.T_frame_laser)
            if inliers < self._acceptance.min_inliers * len(points):
                return NoMatch(reason=f"only {inliers / len(points):.0%} of the beams agree with the reference")
            return _Attempt(alignment=found, inliers=inliers, known=known)

        config = self._acceptance.restarts
        enough = config.below * len(points)
        best = attempt(T_frame_guess)
        if config.below == 0.0 or (isinstance(best, _Attempt) and best.inliers >= enough):
            return best
        for start in other_starts(T_frame_guess, covariance_guess, config):
            other = attempt(start)
            if isinstance(other, NoMatch):
                continue
            if isinstance(best, NoMatch) or other.inliers > best.inliers:
                best = other
            if best.inliers >= enough:
                break
        return best

    def inlier_share(self, reference: Reference, scan: Scan, T_ref_cur: NDArray[np.float64]) -> float:
        """Share of a scan's beams that agree with the reference at a given (3,) robot pose, in [0, 1]."""
        points = self._points_of(scan)
        if not len(points) or not len(reference):
            return 0.0
        T_frame_laser = between(reference.T_ref_laser, compose(T_ref_cur, scan.geometry.T_robot_laser))
        return self._agreeing(reference, points, T_frame_laser)[0] / len(points)

    def _points_of(self, scan: Scan) -> Points:
        points = self._extracted.get(scan)
        if points is None:
            points = self._extracted[scan] = self._extract(scan)
        return points


@dataclass(frozen=True, slots=True, kw_only=True)
class _Attempt:
    """An alignment that is credible, the points that agree with the reference there, and those that fall on it."""

    alignment: Alignment
    inliers: int
    known: int
