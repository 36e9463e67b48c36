"""The reference of ICE matching: surfels, nearest-surfel fields and features of several key scans in one frame."""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from iceg.ice import _field_kernels as field_kernels
from iceg.ice import _hypothesis_kernels as hypothesis_kernels
from iceg.ice.config import FeatureConfig, LocalMapConfig
from iceg.ice.features import FeatureRows, Features
from iceg.ice.points import ScanPoints

_MARGIN = 6.0
_FEATURE_CAPACITY = 1500


@dataclass(frozen=True, slots=True, kw_only=True)
class NearestField:
    """For each cell of a grid the nearest surfel within a radius.

    Attributes:
        origin: (2,) lower left corner of cell [0, 0] [m].
        cell: width of a cell [m].
        radius: farthest distance stored [m].
        nearest: (ny, nx) int32 index of the surfel, -1 where none is near.
        distance2: (ny, nx) float32 squared distance of the cell's centre [m²], radius² where none is near.
    """

    origin: NDArray[np.float64]
    cell: float
    radius: float
    nearest: NDArray[np.int32]
    distance2: NDArray[np.float32]


class LocalMap:
    """Key scans placed in one frame, ready to be matched against.

    Surfels average the points of all scans that fall into one cell and face the same way; features of different
    scans that coincide are merged. `add` extends it by one more scan at little cost.
    """

    def __init__(self, center: NDArray[np.float64], config: LocalMapConfig, features: FeatureConfig) -> None:
        """Start empty around `center`, (2,) [m]; nothing farther than the configured reach (and a margin) enters."""
        self._config = config
        self._merge_radius = features.merge_radius
        half = config.reach + _MARGIN
        origin = np.asarray(center, dtype=np.float64)[:2] - half
        self._surfel_count = 0
        n = ceil(2 * half / config.cell)
        self._table = np.full((n, n, 2), -1, np.int32)
        self._sums = np.empty((4096, 5))
        self._surfels = np.empty((4096, 4))
        self.fine = _empty_field(origin, config.cell, half, config.fine_radius)
        self.coarse = _empty_field(origin, config.coarse_cell, half, config.coarse_radius)
        self._feature_count = 0
        self._kinds = np.empty(_FEATURE_CAPACITY, np.int8)
        self._rows = np.empty((_FEATURE_CAPACITY, 10))
        self._hits = np.empty(_FEATURE_CAPACITY)

    def add(self, scan_points: ScanPoints, features: FeatureRows, T_ref_scan: NDArray[np.float64]) -> None:
        """Add the points and features of one scan taken at `T_ref_scan`."""
        start = self._surfel_count
        self._reserve(start + len(scan_points))
        self._surfel_count = field_kernels.add_surfels(
            scan_points.points,
            scan_points.normals,
            T_ref_scan,
            self.fine.origin,
            self._config.cell,
            self._table,
            self._sums,
            start,
        )
        end = self._surfel_count
        field_kernels.mean_surfels(self._sums, 0, end, self._surfels)
        fine, coarse = self.fine, self.coarse
        field_kernels.stamp_field(
            self._surfels, start, end, fine.origin, fine.cell, fine.radius, fine.nearest, fine.distance2, False
        )
        field_kernels.stamp_field(
            self._surfels, start, end, coarse.origin, coarse.cell, coarse.radius, coarse.nearest, coarse.distance2, True
        )
        self._feature_count = hypothesis_kernels.merge_features(
            features.kinds,
            features.rows,
            len(features),
            T_ref_scan,
            self._merge_radius,
            self._kinds,
            self._rows,
            self._hits,
            self._feature_count,
        )

    @property
    def surfels(self) -> NDArray[np.float64]:
        """(n, 4) mean position [m] and unit normal of each surfel."""
        return self._surfels[: self._surfel_count]

    @property
    def feature_rows(self) -> FeatureRows:
        """The merged features in the layout of the kernels."""
        n = self._feature_count
        return FeatureRows(kinds=self._kinds[:n], rows=self._rows[:n])

    @property
    def features(self) -> Features:
        """The merged features as named arrays."""
        return self.feature_rows.unpack()

    def _reserve(self, capacity: int) -> None:
        while len(self._sums) < capacity:
            self._sums = np.concatenate([self._sums, np.empty_like(self._sums)])
            self._surfels = np.concatenate([self._surfels, np.empty_like(self._surfels)])


def _empty_field(origin: NDArray[np.float64], cell: float, half: float, radius: float) -> NearestField:
    n = ceil(2 * half / cell)
    return NearestField(
        origin=origin,
        cell=cell,
        radius=radius,
        nearest=np.full((n, n), -1, np.int32),
        distance2=np.full((n, n), radius * radius, np.float32),
    )
