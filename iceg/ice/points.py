"""The points of a scan with the normals of the surfaces they lie on."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from iceg.ice import _point_kernels as kernels
from iceg.ice._noise_kernels import RangeNoise
from iceg.ice._normal_kernels import Evenness
from iceg.ice.noise import PLAIN
from iceg.ice.sweeps import joined

JUMP = 0.1
"""Neighbouring points farther apart than this plus three beam spacings lie on two surfaces [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanPoints:
    """The n returns of one scan, in beam order.

    Attributes:
        points: (n, 2) in the robot frame [m].
        normals: (n, 2) unit vectors towards the laser; 0, 0 where no line fits the neighbourhood. Among trunks
            and posts, where most points lie on what is too slim for a line, that faces the laser.
        beams: (n,) int32 index of the beam of each point.
        spreads: (n,) variance of each point across its surface in that of a typical one: more where the noise of the
            laser grows with the range, less where the beam meets the surface flat. 1 for a laser that hardly errs.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    beams: NDArray[np.int32]
    spreads: NDArray[np.float64]

    def __len__(self) -> int:
        """Number of returns."""
        return len(self.points)


def extract_points(scan: Scan, reach: float = 0.2, noise: RangeNoise = PLAIN) -> ScanPoints:
    """End points of a scan and the local surface normals.

    Args:
        scan: the scan.
        reach: neighbours up to this far on either side of a point define its normal [m].
        noise: of the ranges; none worth speaking of unless given.

    Returns:
        The points of all beams with a return.
    """
    geometry = scan.geometry
    n = geometry.n_beams
    points, normals, beams, spreads = np.empty((n, 2)), np.empty((n, 2)), np.empty(n, np.int32), np.empty(n)
    count = kernels.scan_points(
        scan.ranges,
        geometry.directions_robot,
        geometry.origin_robot,
        reach,
        JUMP,
        noise,
        points,
        normals,
        beams,
        spreads,
    )
    return ScanPoints(points=points[:count], normals=normals[:count], beams=beams[:count], spreads=spreads[:count])


@dataclass(frozen=True, slots=True, kw_only=True)
class ThinnedPoints:
    """Some returns of m scans, one scan after the other.

    Attributes:
        points: (n, 2) in the robot frames of their scans [m].
        normals: (n, 2) see `ScanPoints`; those of lines only.
        spreads: (n,) see `ScanPoints`.
        errors: (n, 2) standard deviation of each beyond what all else allows for, along its beam [m].
        starts: (m + 1,) scan k has the points from starts[k] to starts[k + 1].
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    spreads: NDArray[np.float64]
    errors: NDArray[np.float64]
    starts: NDArray[np.int64]


def thinned_points(
    scans: Sequence[Scan],
    offsets: NDArray[np.int64],
    every: int,
    even: Evenness,
    reach: float = 0.2,
    noise: RangeNoise = PLAIN,
) -> ThinnedPoints:
    """Some returns of many scans, at a fraction of the cost of all.

    Args:
        scans: m of them.
        offsets: (m,) the first return of each that is kept, below `every` …
        every: … and one in so many after it.
        even: when neighbours are one surface.
        reach: see `extract_points`.
        noise: of the ranges.

    Returns:
        The points; what is slim has no normal, and what lies on no part of a neighbourhood that is one surface.
    """
    lasers = [list(some) for _, some in groupby(scans, key=lambda scan: id(scan.geometry))]
    found: list[ThinnedPoints] = []
    first = 0
    for some in lasers:
        geometry = some[0].geometry
        capacity = len(some) * -(-geometry.n_beams // every)
        points, normals, errors = np.empty((capacity, 2)), np.empty((capacity, 2)), np.empty((capacity, 2))
        spreads, starts = np.empty(capacity), np.empty(len(some) + 1, np.int64)
        kernels.thinned_points(
            np.stack([scan.ranges for scan in some]),
            geometry.directions_robot,
            geometry.origin_robot,
            reach,
            JUMP,
            noise,
            even,
            offsets[first : first + len(some)],
            every,
            points,
            normals,
            spreads,
            errors,
            starts,
        )
        n = starts[-1]
        found.append(
            ThinnedPoints(points=points[:n], normals=normals[:n], spreads=spreads[:n], errors=errors[:n], starts=starts)
        )
        first += len(some)
    counts = np.concatenate([np.diff(one.starts) for one in found])
    return ThinnedPoints(
        points=joined([one.points for one in found]),
        normals=joined([one.normals for one in found]),
        spreads=joined([one.spreads for one in found]),
        errors=joined([one.errors for one in found]),
        starts=np.cumsum([0, *counts]),
    )
