"""The points of a scan and the reference they are scored against, as one argument of the kernels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iceg.ice.config import RefinementConfig
from iceg.ice.local_map import LocalMap
from iceg.ice.points import ScanPoints
from iceg.ice.refinement import FACING


class Scored(NamedTuple):
    """Points that look for their surfels.

    Attributes:
        points: (n, 2) in the robot frame [m].
        normals: (n, 2) of the surfaces they lie on; 0, 0 where unknown.
        spreads: (n,) variance of each in that of a typical point.
        surfels: (m, 4) x, y and unit normal of the reference.
        nearest: (ny, nx) surfel nearest to each cell of its field, -1 for none.
        origin: (2,) lower left corner of the field [m].
        cell: width of its cells [m].
        scale: width of the Cauchy score of a typical point [m].
        facing: least cosine between the normals of a point and of its surfel …
        alike: … and of those that tell where the scan lies.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    spreads: NDArray[np.float64]
    surfels: NDArray[np.float64]
    nearest: NDArray[np.int32]
    origin: NDArray[np.float64]
    cell: float
    scale: float
    facing: float
    alike: float

    @classmethod
    def of(cls, scan_points: ScanPoints, local_map: LocalMap, config: RefinementConfig) -> "Scored":
        """Points of a scan against the fine field of a local map."""
        field = local_map.fine
        return cls(
            points=scan_points.points,
            normals=scan_points.normals,
            spreads=scan_points.spreads,
            surfels=local_map.surfels,
            nearest=field.nearest,
            origin=field.origin,
            cell=field.cell,
            scale=config.scale,
            facing=FACING,
            alike=config.alike,
        )
