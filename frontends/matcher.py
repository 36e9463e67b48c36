"""The one protocol all scan matchers follow, so that any of them runs in the same pipeline and benchmark."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from graph.measurement import NoMatch, RelativePose


class Matcher(Protocol):
    """Finds where a scan was taken relative to a reference made of earlier scans."""

    def prepare(self, scans: list[Scan], T_ref_scans: NDArray[np.float64]) -> Any:  # noqa: ANN401
        """Build the matcher's own reference from scans placed in one frame.

        Args:
            scans: the key scans that make up the reference, oldest first.
            T_ref_scans: (n, 3) robot pose of each of them in the reference frame.

        Returns:
            Whatever `match` of the same matcher takes as its reference.
        """
        ...

    def match(
        self,
        reference: Any,  # noqa: ANN401
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        """Find the robot pose of `scan` in the frame of `reference`.

        Args:
            reference: what `prepare` returned.
            scan: the new scan.
            T_ref_guess: (3,) where the robot is expected, from odometry.
            covariance_guess: (3, 3) how far off that may be, tangent space at the guess, order x, y, θ.

        Returns:
            The relative pose with a covariance that does not contain the guess (odometry enters the graph on its
            own), or the reason why there is none.
        """
        ...
