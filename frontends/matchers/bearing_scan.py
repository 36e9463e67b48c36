"""A scan as the point matchers see it: its returns in bearing order, seen from the laser."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from graph.elementary import cos_sin


@dataclass(frozen=True, slots=True, kw_only=True)
class BearingScan:
    """The n returns of a scan in the frame of its laser.

    Attributes:
        xy: (n, 2) end points [m].
        bearings: (n,) increasing [rad].
        ranges: (n,) [m].
        resolution: angle between neighbouring beams [rad].
    """

    xy: NDArray[np.float64]
    bearings: NDArray[np.float64]
    ranges: NDArray[np.float64]
    resolution: float

    def __len__(self) -> int:
        """Number of returns."""
        return len(self.xy)

    @classmethod
    def of(cls, scan: Scan) -> "BearingScan":
        """The returns of a scan."""
        geometry = scan.geometry
        hit = np.isfinite(scan.ranges)
        bearings, ranges = geometry.bearings[hit], scan.ranges[hit].astype(np.float64)
        xy = np.empty((len(ranges), 2))
        cos, sin = cos_sin(bearings)
        xy[:, 0], xy[:, 1] = ranges * cos, ranges * sin
        return cls(xy=xy, bearings=bearings, ranges=ranges, resolution=geometry.resolution)

    def links(self, max_gap: float, max_beams: float = 3.0) -> NDArray[np.bool_]:
        """Which neighbours may be joined by a piece of surface.

        Args:
            max_gap: their largest distance [m].
            max_beams: largest angle between them, in beams.

        Returns:
            (n,) bool: whether return i and the next one (the first after the last) are joined.
        """
        step = np.roll(self.xy, -1, axis=0) - self.xy
        turn = np.mod(np.roll(self.bearings, -1) - self.bearings, 2 * np.pi)
        if len(self) and self.bearings[-1] - self.bearings[0] > 2 * np.pi:
            turn[-1] = 0.0  # the last beam lies past the first
        near = step[:, 0] ** 2 + step[:, 1] ** 2 <= max_gap**2
        return np.asarray(near & (turn <= (max_beams + 0.5) * self.resolution), dtype=np.bool_)

    def ends(self, linked: NDArray[np.bool_]) -> NDArray[np.int8]:
        """Where unseen ground begins.

        Args:
            linked: (n,) as from `links`.

        Returns:
            (n,) int8: 2 at the first and the last return unless they are joined, 1 at other ends of joined rows, 0
            elsewhere.
        """
        ends: NDArray[np.int8] = (linked != np.roll(linked, 1)).astype(np.int8)
        if len(linked) and not linked[-1]:
            ends[[0, -1]] = 2
        return ends
