"""The reference of ICE matching: surfels, nearest-surfel fields and features of several key scans in one frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from graph.elementary import exp
from iceg.ice import _hypothesis_kernels as hypothesis_kernels
from iceg.ice import _surfel_kernels as surfel_kernels
from iceg.ice.config import FeatureConfig, LocalMapConfig
from iceg.ice.features import FeatureRows, Features
from iceg.ice.points import ScanPoints
from iceg.ice.sweeps import Sweeps, joined, starts_of, sweeps_of

_FEATURE_CAPACITY = 1500
"""Most features of a local map; further ones are left out."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A scan of the reference and the pose it was taken at, (3,)."""

    scan: Scan
    T_ref_robot: NDArray[np.float64]


class LocalMap:
    """Key scans placed in one frame, ready to be matched against.

    Surfels average the points of all scans that fall into one cell and face the same way; features of different
    scans that coincide are merged. `add` extends it by one more scan at little cost.
    """

    def __init__(
        self, lower: NDArray[np.float64], upper: NDArray[np.float64], config: LocalMapConfig, features: FeatureConfig
    ) -> None:
        """Start empty; points outside the box from `lower` to `upper`, (2,) [m], will not enter."""
        self.views: list[View] = []
        self._config = config
        self._merge_radius = features.merge_radius
        origin = np.asarray(lower, dtype=np.float64)
        size = np.asarray(upper, dtype=np.float64) - origin
        self._surfel_count = 0
        self._table = np.full((ceil(size[1] / config.cell), ceil(size[0] / config.cell), 2), -1, np.int32)
        self._sums = np.empty((0, 5))
        self._surfels = np.empty((0, 4))
        self.fine = _empty_field(origin, size, config.cell, config.fine_radius)
        # Only a search among hypotheses asks for the wide field and the features: they are made when it does.
        self._coarse = _empty_field(origin, size, config.coarse_cell, config.coarse_radius)
        self._in_coarse = 0
        self._new_features: list[tuple[FeatureRows, NDArray[np.float64]]] = []
        self._feature_count = 0
        self._kinds = np.empty(_FEATURE_CAPACITY, np.int8)
        self._rows = np.empty((_FEATURE_CAPACITY, 10))
        self._hits = np.empty(_FEATURE_CAPACITY)
        self._likelihood: tuple[int, float, NDArray[np.float32]] | None = None
        self._sweeps: Sweeps | None = None

    def add(self, scan_points: ScanPoints, features: FeatureRows, T_ref_scan: NDArray[np.float64]) -> None:
        """Add the points and features of one scan taken at `T_ref_scan`, (3,)."""
        self.add_all([scan_points], [features], T_ref_scan[None])

    def add_all(
        self, scan_points: Sequence[ScanPoints], features: Sequence[FeatureRows], T_ref_scans: NDArray[np.float64]
    ) -> None:
        """Add the points and features of scans taken at `T_ref_scans`, (n, 3)."""
        self._fill_coarse()  # with the surfels as they are, before new points move them
        self._add_points(scan_points, T_ref_scans)
        self._new_features += zip(features, T_ref_scans, strict=True)

    def make_room(self, scan_points: ScanPoints, T_ref_scan: NDArray[np.float64], margin: float) -> None:
        """Let the box hold what a scan taken at `T_ref_scan` sees within reach.

        Args:
            scan_points: its points.
            T_ref_scan: (3,) its pose.
            margin: where the box must grow at all, it grows by so much more [m].
        """
        lower, upper = box_around([scan_points.points], T_ref_scan[None], self._config.reach, 0.0)
        (rows, columns), cell = self.fine.nearest.shape, self.fine.cell
        (left, bottom), (right, top) = self.fine.origin.tolist(), upper.tolist()
        end = np.array((left + cell * columns, bottom + cell * rows))
        if lower[0] >= left and lower[1] >= bottom and right <= end[0] and top <= end[1]:
            return
        before = np.where(lower < self.fine.origin, self.fine.origin - lower + margin, 0.0)
        after = np.where(upper > end, upper - end + margin, 0.0)
        self._table = _padded(self._table, before, after, self.fine.cell, -1)
        self.fine, self._coarse = _grown(self.fine, before, after), _grown(self._coarse, before, after)
        self._likelihood = None

    def _add_points(self, scan_points: Sequence[ScanPoints], T_ref_scans: NDArray[np.float64]) -> None:
        starts, field = starts_of(scan_points), self.fine
        self._reserve(self._surfel_count + int(starts[-1]))
        self._surfel_count = surfel_kernels.add_points(
            joined([one.points for one in scan_points]),
            joined([one.normals for one in scan_points]),
            starts,
            T_ref_scans,
            self._config.sharpen,
            self._table,
            self._sums,
            self._surfels,
            self._surfel_count,
            field.origin,
            field.cell,
            field.radius,
            field.nearest,
            field.distance2,
        )

    @property
    def surfels(self) -> NDArray[np.float64]:
        """(n, 4) mean position [m] and unit normal of each surfel."""
        return self._surfels[: self._surfel_count]

    @property
    def sweeps(self) -> Sweeps:
        """The beams of the views."""
        if self._sweeps is None or len(self._sweeps.T_ref_robots) != len(self.views):
            poses = np.array([view.T_ref_robot for view in self.views])
            self._sweeps = sweeps_of([view.scan for view in self.views], poses)
        return self._sweeps

    @property
    def coarse(self) -> NearestField:
        """The wide field."""
        self._fill_coarse()
        return self._coarse

    def likelihood(self, sigma: float) -> NDArray[np.float32]:
        """(ny, nx) exp(-d²/2σ²) of the wide field, worked out once for as long as the field stays as it is."""
        if self._likelihood is None or self._likelihood[:2] != (self._surfel_count, sigma):
            distance2 = self.coarse.distance2
            self._likelihood = (self._surfel_count, sigma, exp(-0.5 / sigma**2 * distance2).astype(np.float32))
        return self._likelihood[2]

    def _fill_coarse(self) -> None:
        if self._in_coarse < self._surfel_count:
            field = self._coarse
            surfel_kernels.stamp_field(
                self._surfels,
                self._in_coarse,
                self._surfel_count,
                field.origin,
                field.cell,
                field.radius,
                field.nearest,
                field.distance2,
                True,
            )
            self._in_coarse = self._surfel_count

    @property
    def feature_rows(self) -> FeatureRows:
        """The merged features in the layout of the kernels."""
        if self._new_features:
            self._merge_features([one for one, _ in self._new_features], np.array([T for _, T in self._new_features]))
            self._new_features.clear()
        n = self._feature_count
        return FeatureRows(kinds=self._kinds[:n], rows=self._rows[:n])

    def _merge_features(self, features: Sequence[FeatureRows], T_ref_scans: NDArray[np.float64]) -> None:
        self._feature_count = hypothesis_kernels.merge_features(
            joined([one.kinds for one in features]),
            joined([one.rows for one in features]),
            starts_of([one.kinds for one in features]),
            T_ref_scans,
            self._merge_radius,
            self._kinds,
            self._rows,
            self._hits,
            self._feature_count,
        )

    @property
    def features(self) -> Features:
        """The merged features as named arrays."""
        return self.feature_rows.unpack()

    def _reserve(self, capacity: int) -> None:
        if len(self._sums) < capacity:
            n, capacity = self._surfel_count, max(capacity, 2 * len(self._sums))
            sums, surfels = np.empty((capacity, 5)), np.empty((capacity, 4))
            sums[:n], surfels[:n] = self._sums[:n], self._surfels[:n]
            self._sums, self._surfels = sums, surfels


def box_around(
    points: list[NDArray[np.float64]], T_ref_scans: NDArray[np.float64], reach: float, margin: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Smallest box around the points of several scans, on whole metres, so that the cells of all references lie alike.

    Args:
        points: (n_i, 2) of each scan, robot frame [m].
        T_ref_scans: (m, 3) their poses.
        reach: from the last of them, to the farthest point that counts [m]; farther where that would leave out too much
            of what it sees, as in halls and outdoors: then as far as it sees.
        margin: added on every side [m].

    Returns:
        Lower and upper corner, (2,) each.
    """
    lower, upper = np.empty(2), np.empty(2)
    surfel_kernels.box_around(joined(points), starts_of(points), T_ref_scans, reach, margin, lower, upper)
    return lower, upper


def _grown(field: NearestField, before: NDArray[np.float64], after: NDArray[np.float64]) -> NearestField:
    """The same field with room on each side, (2,) [m], in whole cells."""
    return NearestField(
        origin=field.origin - field.cell * np.ceil(before / field.cell),
        cell=field.cell,
        radius=field.radius,
        nearest=_padded(field.nearest, before, after, field.cell, -1),
        distance2=_padded(field.distance2, before, after, field.cell, field.radius**2),
    )


def _padded(
    cells: NDArray[Any], before: NDArray[np.float64], after: NDArray[np.float64], cell: float, empty: float
) -> NDArray[Any]:
    """(ny, nx, ...) cells with empty ones around them, as far as `before` and `after`, (2,) x and y [m]."""
    (left, below), (right, above) = (np.ceil(side / cell).astype(int) for side in (before, after))
    ny, nx = cells.shape[:2]
    padded = np.full((ny + below + above, nx + left + right, *cells.shape[2:]), empty, cells.dtype)
    padded[below : below + ny, left : left + nx] = cells
    return padded


def _empty_field(origin: NDArray[np.float64], size: NDArray[np.float64], cell: float, radius: float) -> NearestField:
    shape = (ceil(size[1] / cell), ceil(size[0] / cell))
    return NearestField(
        origin=origin,
        cell=cell,
        radius=radius,
        nearest=np.full(shape, -1, np.int32),
        distance2=np.full(shape, radius * radius, np.float32),
    )
