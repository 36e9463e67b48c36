"""Points with the uncertainty that weighted scan matching gives them (Pfister et al. 2002, 2007)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _point_noise_kernels as kernels
from frontends.matchers._weighted_kernels import Cloud
from frontends.matchers.bearing_scan import BearingScan
from frontends.matchers.errors import require
from frontends.matchers.quad_tree import QuadTree
from frontends.scan import Scan
from graph.se2 import between


@dataclass(frozen=True, kw_only=True)
class PointNoiseConfig:
    """How uncertain a point is, and how far from its true counterpart the nearest one may lie."""

    range_sigma: float = 0.01
    """Standard deviation of one range [m]."""
    angle_sigma: float = 0.002
    """Standard deviation of a beam's direction [rad]."""
    neighbours: int = 3
    """Returns to either side that give a point the direction of its wall."""
    max_gap: float = 0.5
    """Neighbouring returns nearer than this lie on one wall [m]."""
    max_spread: float = 1.0
    """Longest distance to the next point along the wall that counts, at glancing incidence [m]."""

    def __post_init__(self) -> None:
        for name in ("range_sigma", "angle_sigma", "max_gap", "max_spread"):
            value = getattr(self, name)
            require(value > 0, f"point_noise.{name} must be positive, found {value}")
        require(self.neighbours >= 1, f"point_noise.neighbours must be at least 1, found {self.neighbours}")


@dataclass(frozen=True, slots=True, kw_only=True)
class WeightedPoints:
    """n points, their covariances and a quad tree over them, in the frame of a laser.

    Attributes:
        tree: the points.
        noise: (n, 3) covariance of each point as xx, xy, yy [m²].
        tangents: (n, 2) unit vectors along the walls.
        spreads: (n,) standard deviation of a correspondence along the wall, because the laser samples it [m].
        ends: (n,) where unseen ground begins, see `BearingScan.ends`.
        T_ref_laser: (3,) the laser in the reference frame of the caller.
    """

    tree: QuadTree
    noise: NDArray[np.float64]
    tangents: NDArray[np.float64]
    spreads: NDArray[np.float64]
    ends: NDArray[np.int8]
    T_ref_laser: NDArray[np.float64]

    def cloud(self) -> Cloud:
        """The points in the layout of the kernels."""
        return Cloud(self.tree.xy, self.noise, self.tangents, self.spreads, self.ends, self.tree.nodes)

    def __len__(self) -> int:
        """Number of points."""
        return len(self.noise)


def weigh_scan(scan: Scan, config: PointNoiseConfig) -> WeightedPoints:
    """The returns of one scan in the frame of its laser."""
    points = BearingScan.of(scan)
    n = len(points)
    noise, tangents, spreads = np.empty((n, 3)), np.empty((n, 2)), np.empty(n)
    linked = points.links(config.max_gap)
    kernels.point_model(
        points.xy,
        linked,
        points.resolution,
        config.range_sigma,
        config.angle_sigma,
        config.neighbours,
        config.max_spread,
        noise,
        tangents,
        spreads,
    )
    return WeightedPoints(
        tree=QuadTree.of(points.xy),
        noise=noise,
        tangents=tangents,
        spreads=spreads,
        ends=points.ends(linked),
        T_ref_laser=np.zeros(3),
    )


def merged(scans: list[WeightedPoints], T_ref_lasers: NDArray[np.float64], reach: float = math.inf) -> WeightedPoints:
    """All points of several scans in the frame of the last laser.

    Args:
        scans: each in the frame of its own laser.
        T_ref_lasers: (n, 3) those lasers in one frame.
        reach: points farther than this from the last laser are left out [m].

    Returns:
        The points with one quad tree over all of them.
    """
    n = sum(len(scan) for scan in scans)
    xy, noise, tangents = np.empty((n, 2)), np.empty((n, 3)), np.empty((n, 2))
    begin = 0
    for scan, T_last_laser in zip(scans, between(T_ref_lasers[-1], T_ref_lasers), strict=True):
        rows = slice(begin, begin + len(scan))
        kernels.place(scan.tree.xy, scan.noise, scan.tangents, T_last_laser, xy[rows], noise[rows], tangents[rows])
        begin = rows.stop
    spreads = np.concatenate([scan.spreads for scan in scans])
    near = (xy * xy).sum(axis=1) <= reach**2
    return WeightedPoints(
        tree=QuadTree.of(xy[near]),
        noise=noise[near],
        tangents=tangents[near],
        spreads=spreads[near],
        ends=np.zeros(np.count_nonzero(near), np.int8),  # what one scan did not see another one may have
        T_ref_laser=T_ref_lasers[-1],
    )
