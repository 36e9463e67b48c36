"""Does a scan belong where a match puts it: do its beams end on the reference, and does it see what is there?"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from iceg.ice import _agreement_kernels as kernels
from iceg.ice import _visibility_kernels as visibility
from iceg.ice.config import RefinementConfig
from iceg.ice.local_map import LocalMap
from iceg.ice.points import ScanPoints
from iceg.ice.refinement import FACING
from iceg.ice.sweeps import Sweeps, joined, starts_of, sweeps_of

_JUDGED_POINTS = 2000
"""Points that the scans of the reference judge in all; of a scan every second or third point if there are more."""
_EVEN_ODDS = 5.0
"""Surfels added to those seen, so that a few contradictions among few prove nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Counts that add up over several scans.

    Attributes:
        points: returns of the scan.
        known: those that fall on known reference.
        inliers: those that agree with it.
        seen: reference surfels in view on which a beam ends.
        contradicted: reference surfels in view that the beams pass through.
    """

    points: int = 0
    known: int = 0
    inliers: int = 0
    seen: int = 0
    contradicted: int = 0

    def __add__(self, other: "Agreement") -> "Agreement":
        """Counts of both."""
        return Agreement(
            points=self.points + other.points,
            known=self.known + other.known,
            inliers=self.inliers + other.inliers,
            seen=self.seen + other.seen,
            contradicted=self.contradicted + other.contradicted,
        )

    @property
    def overlap(self) -> float:
        """Share of the returns on known reference."""
        return self.known / max(1, self.points)

    @property
    def fit(self) -> float:
        """Share of those that agree."""
        return self.inliers / max(1, self.known)

    @property
    def view(self) -> float:
        """Share of the surfels in view that are seen; where none is in view none is contradicted."""
        in_view = self.seen + self.contradicted
        return self.seen / in_view if in_view else 1.0

    @property
    def evidence(self) -> float:
        """Points that agree, less where the scan looks through the reference."""
        return self.inliers * (self.seen + _EVEN_ODDS) / (self.seen + self.contradicted + _EVEN_ODDS)


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinedScans:
    """The points and beams of several scans, for kernels that go through all of them at once.

    Attributes:
        points: (n, 2) in the frames of their scans [m].
        normals: (n, 2); 0, 0 where unknown.
        spreads: (n,) variance of each in that of a typical point.
        starts: (m + 1,) scan k has the points from starts[k] to starts[k + 1].
        sweeps: the beams; where they were taken is not said.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    spreads: NDArray[np.float64]
    starts: NDArray[np.int64]
    sweeps: Sweeps

    @classmethod
    def of(cls, scans: Sequence[Scan], scan_points: Sequence[ScanPoints]) -> "JoinedScans":
        """One scan or more, with the points of each."""
        return cls(
            points=joined([one.points for one in scan_points]),
            normals=joined([one.normals for one in scan_points]),
            spreads=joined([one.spreads for one in scan_points]),
            starts=starts_of(scan_points),
            sweeps=sweeps_of(scans, np.zeros((len(scans), 3))),
        )


def agreement(
    scans: Sequence[Scan],
    scan_points: Sequence[ScanPoints],
    local_map: LocalMap,
    T_ref_scans: NDArray[np.float64],
    config: RefinementConfig,
) -> Agreement:
    """Compare scans with a local map at given poses, in both directions.

    Args:
        scans: one at least.
        scan_points: their points.
        local_map: the reference.
        T_ref_scans: (n, 3) the poses to judge.
        config: what counts as agreeing.

    Returns:
        The counts, of all scans together.
    """
    return agreements(JoinedScans.of(scans, scan_points), local_map, T_ref_scans[None], config)[0]


def agreements(
    scans: JoinedScans,
    local_map: LocalMap,
    placements: NDArray[np.float64],
    config: RefinementConfig,
    least_overlap: float = 0.0,
    least_fit: float = 0.0,
) -> list[Agreement]:
    """Compare scans, placed in several ways, with a local map.

    Args:
        scans: the scans.
        local_map: the reference.
        placements: (p, n, 3) the poses to judge.
        config: what counts as agreeing.
        least_overlap: the view is not judged of a placement with less overlap …
        least_fit: … or less fit than this.

    Returns:
        The counts, of all scans together, of each placement.
    """
    counts = np.empty((len(placements), 4), np.int64)
    kernels.compare(
        scans.points,
        scans.normals,
        scans.spreads,
        scans.starts,
        scans.sweeps,
        placements,
        local_map.surfels,
        local_map.fine.nearest,
        local_map.fine.origin,
        local_map.fine.cell,
        FACING,
        config.agreeing * config.scale,
        config.view_reach,
        config.margin,
        least_overlap,
        least_fit,
        counts,
    )
    n_points = len(scans.points)
    return [
        Agreement(points=n_points, known=known, inliers=inliers, seen=seen, contradicted=contradicted)
        for known, inliers, seen, contradicted in counts.tolist()
    ]


def view(scan: Scan, local_map: LocalMap, T_ref_cur: NDArray[np.float64], config: RefinementConfig) -> tuple[int, int]:
    """How many surfels in view a scan taken at `T_ref_cur`, (3,), sees, and how many its beams pass through."""
    geometry = scan.geometry
    seen, contradicted = kernels.visible_agreement(
        local_map.surfels,
        T_ref_cur,
        geometry.T_robot_laser,
        geometry.bearings[0],
        geometry.resolution,
        scan.ranges,
        config.view_reach,
        config.margin,
    )
    return seen, contradicted


def contradictions(
    scan: Scan,
    scan_points: ScanPoints,
    local_map: LocalMap,
    T_ref_cur: NDArray[np.float64],
    cell: float,
    config: RefinementConfig,
) -> int:
    """How many beams of a scan taken at `T_ref_cur` deny the reference or are denied by it.

    A beam does so that passes through a surface of the reference, or that ends where scans of the reference looked
    through and none saw anything.

    Args:
        scan: the scan.
        scan_points: its points.
        local_map: the reference.
        T_ref_cur: (3,) the pose to judge.
        cell: width of a surfel of the reference [m].
        config: what a beam must lie beyond to deny a surface.

    Returns:
        The number of beams, those that do both counted twice.
    """
    geometry = scan.geometry
    through = visibility.beams_through(
        local_map.surfels,
        T_ref_cur,
        geometry.T_robot_laser,
        geometry.bearings[0],
        geometry.resolution,
        scan.ranges,
        config.contradiction_reach,
        config.margin,
        config.across,
        cell,
        np.empty(geometry.n_beams, np.bool_),
    )
    every = max(1, len(scan_points) * len(local_map.views) // _JUDGED_POINTS)
    seen_through = visibility.judge_points_by_all(
        scan_points.points,
        scan_points.normals,
        every,
        T_ref_cur,
        local_map.sweeps,
        config.contradiction_reach,
        config.margin,
        config.across,
        np.empty(len(scan_points), np.int8),
    )
    return through + every * int(seen_through)
