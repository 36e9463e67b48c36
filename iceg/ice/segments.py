"""Straight segments of a scan: split-and-merge with a maximum-likelihood line fit (paper, section III.C.1)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from graph.elementary import arctan2
from graph.short_repr import short_repr
from iceg.ice import _feature_kernels as kernels
from iceg.ice.config import SegmentConfig
from iceg.ice.points import ScanPoints, extract_points

_CAPACITY = 120
"""Most segments of one scan."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Segments:
    """The n segments of one scan in scan order (counter-clockwise as seen from the laser).

    Attributes:
        centroids: (n, 2) in the robot frame [m].
        headings: (n,) direction from the first to the last point [rad].
        endpoints: (n, 2, 2) first and last point, projected onto the line [m].
        offset_variances: (n,) of the line's distance at the centroid [m²].
        heading_variances: (n,) [rad²]; independent of the offset at the centroid.
        point_ranges: (n, 2) index of the first and the last point in the scan's `ScanPoints`.
    """

    centroids: NDArray[np.float64]
    headings: NDArray[np.float64]
    endpoints: NDArray[np.float64]
    offset_variances: NDArray[np.float64]
    heading_variances: NDArray[np.float64]
    point_ranges: NDArray[np.int64]

    __repr__ = short_repr

    def __len__(self) -> int:
        """Number of segments."""
        return len(self.centroids)


def extract_segments(
    scan: Scan, config: SegmentConfig | None = None, scan_points: ScanPoints | None = None
) -> Segments:
    """Cut a scan into straight segments.

    Args:
        scan: the scan.
        config: thresholds.
        scan_points: its points, when they are at hand already.

    Returns:
        The segments, each with the covariance of its line.
    """
    config = config or SegmentConfig()
    rows = segment_rows(scan, config, scan_points or extract_points(scan))
    directions = rows[:, kernels.TX : kernels.TY + 1]
    centroids = rows[:, kernels.CX : kernels.CY + 1]
    along = rows[:, kernels.FIRST : kernels.LAST + 1]
    return Segments(
        centroids=centroids,
        headings=arctan2(directions[:, 1], directions[:, 0]),
        endpoints=centroids[:, None, :] + along[:, :, None] * directions[:, None, :],
        offset_variances=rows[:, kernels.V_OFFSET],
        heading_variances=rows[:, kernels.V_ANGLE],
        point_ranges=rows[:, kernels.I_FIRST : kernels.I_LAST + 1].astype(np.int64),
    )


def segment_rows(scan: Scan, config: SegmentConfig, scan_points: ScanPoints) -> NDArray[np.float64]:
    """The segments as (s, SEGMENT_COLUMNS) kernel rows, see `_feature_kernels`."""
    rows = np.empty((_CAPACITY, kernels.SEGMENT_COLUMNS))
    count = kernels.extract_segments(
        scan_points.points,
        scan_points.beams,
        scan.geometry.origin_robot,
        scan.geometry.resolution,
        config.gap,
        config.split,
        config.split_sigmas,
        config.min_points,
        config.min_length,
        config.range_noise,
        rows,
    )
    return rows[:count]


def smoothed_on_segments(
    scan_points: ScanPoints, rows: NDArray[np.float64], origin: NDArray[np.float64], config: SegmentConfig
) -> ScanPoints:
    """The points of long segments put onto their lines, bent where the wall is, with the normals of these.

    A curve through many points is known better than any of them: quantised ranges and the few neighbours of a point
    would bend walls and tilt their normals.

    Args:
        scan_points: points of a scan.
        rows: its segments in the layout of the kernels.
        origin: (2,) position of the laser [m].
        config: which segments count as walls.

    Returns:
        New points; those off any wall are unchanged.
    """
    points, normals = scan_points.points.copy(), scan_points.normals.copy()
    kernels.smooth_on_segments(
        scan_points.points, origin, rows, config.wall_points, config.wall_length, points, normals
    )
    return replace(scan_points, points=points, normals=normals)
