"""What the pipeline asks of a matcher beyond matching, when it wants maps that grow and places that can be doubted."""

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from frontends.matcher import TrackingMatcher
from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from iceg.ice.points import ScanPoints
from iceg.ice.tracking import Followed, Limits, Standing
from iceg.ice.verification import Agreement


@runtime_checkable
class MapMatcher(TrackingMatcher, Protocol):
    """A matcher whose references can be extended, and whose matches can be questioned; `IceMatcher` is one."""

    def extend(self, reference: Any, scan: Scan, T_ref_scan: NDArray[np.float64]) -> None:  # noqa: ANN401
        """Add one more scan to a reference, at the (3,) pose given."""
        ...

    def agreement(self, reference: Any, scan: Scan, T_ref_cur: NDArray[np.float64]) -> Agreement:  # noqa: ANN401
        """Compare a scan with a reference at a given (3,) pose, both ways."""
        ...

    def held(
        self,
        reference: Any,  # noqa: ANN401
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        """The match nearest to a (3,) guess that is right but for centimetres: along what is weak it stays there."""
        ...

    def alternatives(
        self,
        reference: Any,  # noqa: ANN401
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> list[NDArray[np.float64]]:
        """Distinct (3,) poses around the guess that fit, the best first: with several the place is ambiguous."""
        ...


@runtime_checkable
class FollowingMatcher(MapMatcher, Protocol):
    """A matcher that follows many scans at once, a tenth of the time where nothing is in doubt."""

    def follow(
        self,
        reference: Any,  # noqa: ANN401
        ranges: NDArray[np.float32],
        steps: NDArray[np.float64],
        geometry: ScanGeometry,
        standing: Standing,
        odometry: OdometryModel,
        limits: Limits,
    ) -> Followed:
        """As `track` for scan after scan, see `iceg.ice.tracking.follow_scans`."""
        ...

    def keep(self, scan: Scan, points: ScanPoints) -> None:
        """Take what `follow` made of a scan, lest it be made again."""
        ...
