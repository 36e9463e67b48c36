"""Compiled loops that tell which scan of a reference was the last to see what holds a match."""

from math import cos, inf, sin

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled
from iceg.ice._visibility_kernels import SEEN, _laser, _place, _verdict
from iceg.ice.sweeps import Sweeps

F64 = NDArray[np.float64]


@compiled
def last_seen(
    points: F64,
    normals: F64,
    spreads: F64,
    every: int,
    T_ref_cur: F64,
    sweeps: Sweeps,
    margin: float,
    told: F64,
) -> None:
    """Sum what the points of a scan tell of its pose, by the scan of the reference that was the last to see them.

    That is Σ JᵀJ / spread, J by a point's own normal: what lies on a straight wall tells nothing along it. What no scan
    of the reference sees, and what has no normal, is left out.

    Args:
        points: (n, 2) in the robot frame [m].
        normals: (n, 2); 0, 0 where unknown.
        spreads: (n,) variance of each in that of a typical point.
        every: only every so many points are asked.
        T_ref_cur: (3,) pose of the scan.
        sweeps: the scans of the reference, m of them, the last one last.
        margin: a beam sees what lies no farther than this from where it ends, across its surface [m].
        told: (m, 3, 3) output: information in the tangent space of the robot, in that of a typical point.
    """
    told[:] = 0.0
    c, s, waiting = cos(T_ref_cur[2]), sin(T_ref_cur[2]), np.zeros(len(points), np.bool_)
    for i in range(0, len(points), every):
        waiting[i] = normals[i, 0] != 0.0 or normals[i, 1] != 0.0
    for k in range(len(told) - 1, -1, -1):
        laser = _laser(sweeps.T_ref_robots[k], sweeps.T_robot_lasers[k])
        first, resolution = sweeps.first_bearings[k], sweeps.resolutions[k]
        ranges = sweeps.ranges[sweeps.starts[k] : sweeps.starts[k + 1]]
        for i in range(0, len(points), every):
            if not waiting[i]:
                continue
            px, py, nx, ny = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
            x, y = T_ref_cur[0] + c * px - s * py, T_ref_cur[1] + s * px + c * py
            mx, my = c * nx - s * ny, s * nx + c * ny
            beam, distance, facing = _place(x, y, mx, my, laser, first, resolution, len(ranges), inf)
            if beam >= 0 and _verdict(ranges, beam, distance, margin / facing) == SEEN:
                waiting[i] = False
                _tell(nx, ny, ny * px - nx * py, 1.0 / spreads[i], told[k])


@compiled
def _tell(x: float, y: float, turn: float, weight: float, told: F64) -> None:
    """Add a point's information."""
    told[0, 0] += weight * x * x
    told[0, 1] += weight * x * y
    told[0, 2] += weight * x * turn
    told[1, 1] += weight * y * y
    told[1, 2] += weight * y * turn
    told[2, 2] += weight * turn * turn
    told[1, 0], told[2, 0], told[2, 1] = told[0, 1], told[0, 2], told[1, 2]
