"""A matcher of two methods whose answers a test knows, with all else that the pipeline asks and no objections."""

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.ice.tracking import Followed, Limits, Standing
from iceg.ice.verification import Agreement


class ScanByScan:
    """What follows no scans at once: each is tracked by itself."""

    def follow(
        self,
        reference: Any,
        ranges: NDArray[np.float32],
        steps: NDArray[np.float64],
        geometry: ScanGeometry,
        standing: Standing,
        odometry: OdometryModel,
        limits: Limits,
    ) -> Followed:
        del reference, ranges, steps, geometry, odometry, limits
        return Followed(T_ref_robots=np.empty((0, 3)), motion=standing.motion, key_scan=None)


class ScriptedMatcher(ScanByScan):
    """Every pose agrees, a little; nothing else fits."""

    judge = IceMatcher()

    @abstractmethod
    def match(
        self, reference: Any, scan: Scan, T_ref_guess: NDArray[np.float64], covariance_guess: NDArray[np.float64]
    ) -> RelativePose | NoMatch: ...

    def position_information(self, reference: Any, scan: Scan, T_ref_cur: NDArray[np.float64]) -> NDArray[np.float64]:
        """As if a wall stood on every side."""
        del reference, scan, T_ref_cur
        return 1e8 * np.eye(2)

    def last_seen(self, reference: Any, scan: Scan, T_ref_cur: NDArray[np.float64]) -> NDArray[np.float64]:
        """As if the newest scan of the reference saw all."""
        del reference, scan, T_ref_cur
        return np.eye(3)[None]

    def judged(self, reference: Any) -> LocalMap:
        raise NotImplementedError

    def track(
        self, reference: Any, scan: Scan, T_ref_guess: NDArray[np.float64], covariance_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | NoMatch:
        match = self.match(reference, scan, T_ref_guess, covariance_guess)
        return match if isinstance(match, NoMatch) else match.T_ref_cur

    def extend(self, reference: Any, scan: Scan, T_ref_scan: NDArray[np.float64]) -> None: ...

    def agreement(self, reference: Any, scan: Scan, T_ref_cur: NDArray[np.float64]) -> Agreement:
        del reference, scan, T_ref_cur
        return Agreement(points=12, known=10, inliers=10)

    def match_near(self, reference: Any, scan: Scan, T_ref_guess: NDArray[np.float64]) -> RelativePose | NoMatch:
        del reference, scan, T_ref_guess
        return NoMatch(reason="only where it is said to be")

    def alternatives(
        self, reference: Any, scan: Scan, T_ref_guess: NDArray[np.float64], covariance_guess: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        raise NotImplementedError
