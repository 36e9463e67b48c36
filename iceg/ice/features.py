"""Features of a scan: corners, ends of walls and intersections (paper, section III.B)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.checked_arguments import expect
from frontends.scan import Scan
from graph.short_repr import short_repr
from iceg.ice import _feature_kernels as kernels
from iceg.ice.config import FeatureConfig, SegmentConfig
from iceg.ice.points import ScanPoints, extract_points
from iceg.ice.segments import segment_rows

CORNER, END_OF_WALL, INTERSECTION = 0, 1, 2
KIND_NAMES = ("corner", "end_of_wall", "intersection")
_CAPACITY = 250
"""Most features of one scan."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Features:
    """The n features of one scan or of a local map, as parallel arrays.

    Attributes:
        kinds: (n,) int8: CORNER, END_OF_WALL or INTERSECTION.
        positions: (n, 2) [m], in the frame of their owner (the robot frame for one scan).
        directions: (n, 2) headings [rad] of the walls that start at the feature. Column 0 is the wall on the
            clockwise side as seen from the laser, column 1 the wall on the counter-clockwise side; NaN where there is
            none: a corner and an intersection have both, an end of wall exactly one (either column).
        covariances: (n, 2, 2) of the positions [m²], same frame.
        direction_variances: (n,) of the directions [rad²].
        distances: (n,) from the laser when observed [m].
        real: (n,) bool; False for a wall end that is only occluded or cut off by the field of view: good for
            hypotheses, no landmark.
    """

    kinds: NDArray[np.int8]
    positions: NDArray[np.float64]
    directions: NDArray[np.float64]
    covariances: NDArray[np.float64]
    direction_variances: NDArray[np.float64]
    distances: NDArray[np.float64]
    real: NDArray[np.bool_]

    __repr__ = short_repr

    def __len__(self) -> int:
        """Number of features."""
        return len(self.kinds)


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureRows:
    """The same features in the layout of the kernels.

    Attributes:
        kinds: (n,) int8.
        rows: (n, 10) x, y, clockwise heading, counter-clockwise heading, var x, cov xy, var y, heading variance,
            1 if real, distance from the laser.
    """

    kinds: NDArray[np.int8]
    rows: NDArray[np.float64]

    def __len__(self) -> int:
        """Number of features."""
        return len(self.kinds)

    def unpack(self) -> Features:
        """As named arrays."""
        rows = self.rows
        covariances = rows[:, [4, 5, 5, 6]].reshape(-1, 2, 2)
        return Features(
            kinds=self.kinds,
            positions=rows[:, :2],
            directions=rows[:, 2:4],
            covariances=covariances,
            direction_variances=rows[:, 7],
            distances=rows[:, 9],
            real=rows[:, 8] > 0.5,
        )


def packed(features: Features) -> FeatureRows:
    """The inverse of `FeatureRows.unpack`."""
    rows = np.column_stack(
        [
            features.positions,
            features.directions,
            features.covariances[:, 0, 0],
            features.covariances[:, 0, 1],
            features.covariances[:, 1, 1],
            features.direction_variances,
            features.real,
            features.distances,
        ]
    )
    return FeatureRows(kinds=np.asarray(features.kinds, dtype=np.int8), rows=rows.astype(np.float64))


def extract_features(
    scan: Scan, config: FeatureConfig | None = None, segments: SegmentConfig | None = None
) -> Features:
    """Corners, ends of walls and intersections of one scan.

    Args:
        scan: the scan.
        config: thresholds of the features.
        segments: thresholds of the segments they come from.

    Returns:
        The features in the robot frame, corners and intersections first.

    Raises:
        TypeError: the scan is of another type.
    """
    expect(scan, Scan, "scan", "iceg.Scan, as iceg.Scan.from_ranges and log.scan(index) give")
    scan_points = extract_points(scan)
    lines = segment_rows(scan, segments or SegmentConfig(), scan_points)
    return feature_rows(scan, config or FeatureConfig(), lines, scan_points).unpack()


def feature_rows(scan: Scan, config: FeatureConfig, lines: NDArray[np.float64], scan_points: ScanPoints) -> FeatureRows:
    """Features of segments, both in the layout of the kernels.

    Args:
        scan: the scan.
        config: thresholds.
        lines: (s, SEGMENT_COLUMNS) its segments, see `segment_rows`.
        scan_points: its points.
    """
    kinds, rows = np.empty(_CAPACITY, np.int8), np.empty((_CAPACITY, kernels.FEATURE_COLUMNS))
    count = kernels.extract_features(
        scan_points.points,
        scan_points.beams,
        scan.geometry.origin_robot,
        scan.geometry.resolution,
        lines,
        config.corner_gap,
        config.extension,
        config.min_angle,
        config.weak_sigma,
        kinds,
        rows,
    )
    # Copies, so that what is kept of a scan is no larger than its features.
    return FeatureRows(kinds=kinds[:count].copy(), rows=rows[:count].copy())
