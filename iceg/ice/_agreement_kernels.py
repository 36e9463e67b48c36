"""Compiled loops that compare scans with a local map: points on the reference, and surfels the beams see."""

from math import atan2, cos, floor, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both
from iceg.ice._refinement_kernels import partner
from iceg.ice.sweeps import Sweeps

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]

_NEAREST_JUDGED = 0.3
"""Surfels nearer to the laser than this are not judged [m] …"""
_FLATTEST = 0.25
"""… nor those seen at a flatter angle than this (cosine between beam and normal)."""


@compiled
def compare(
    points: F64,
    normals: F64,
    spreads: F64,
    starts: I64,
    sweeps: Sweeps,
    placements: F64,
    surfels: F64,
    nearest: I32,
    origin: F64,
    cell: float,
    facing: float,
    limit: float,
    reach: float,
    margin: float,
    least_overlap: float,
    least_fit: float,
    counts: I64,
) -> None:
    """Compare scans, placed in one or several ways, with a reference.

    Args:
        points: (n, 2) in the frames of their scans [m].
        normals: (n, 2); 0, 0 where unknown.
        spreads: (n,) variance of each in that of a typical point.
        starts: (m + 1,) scan k has the points from starts[k] to starts[k + 1].
        sweeps: the beams of the same scans; where they were taken does not count.
        placements: (p, m, 3) poses of the scans in each of the ways.
        surfels: (s, 4) of the reference.
        nearest: (ny, nx) of its field.
        origin: (2,) lower left corner of the field [m].
        cell: width of its cells [m].
        facing: least cosine between the normals of a point and of its surfel.
        limit: a typical point no farther than this from its surfel's line agrees with it [m].
        reach: see `visible_agreement`.
        margin: …
        least_overlap: where a smaller share of the points has a surfel …
        least_fit: … or a smaller share of these agrees with it, no surfels are counted.
        counts: (p, 4) output: points with a surfel, those that agree with it, surfels seen, surfels looked through.
    """
    for way in range(len(placements)):
        known, inliers = _points_on_reference(
            points, normals, spreads, starts, placements[way], surfels, nearest, origin, cell, facing, limit
        )
        seen, contradicted = 0, 0
        if known >= least_overlap * starts[-1] and inliers >= least_fit * known:
            seen, contradicted = _surfels_in_view(surfels, placements[way], sweeps, reach, margin)
        counts[way, 0], counts[way, 1], counts[way, 2], counts[way, 3] = known, inliers, seen, contradicted


@compiled
def _points_on_reference(
    points: F64,
    normals: F64,
    spreads: F64,
    starts: I64,
    poses: F64,
    surfels: F64,
    nearest: I32,
    origin: F64,
    cell: float,
    facing: float,
    limit: float,
) -> tuple[int, int]:
    """How many points of scans at their poses have a surfel, and how many of these agree with it, see `compare`."""
    known, inliers = 0, 0
    x0, y0, cells_per_metre = origin[0], origin[1], 1.0 / cell
    for scan in range(len(poses)):
        px, py, c, s = poses[scan, 0], poses[scan, 1], cos(poses[scan, 2]), sin(poses[scan, 2])
        for i in range(starts[scan], starts[scan + 1]):
            x = px + (c * points[i, 0] - s * points[i, 1])
            y = py + (s * points[i, 0] + c * points[i, 1])
            nx, ny = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
            k = partner(x, y, nx, ny, surfels, nearest, x0, y0, cells_per_metre, facing)
            if k >= 0:
                r = surfels[k, 2] * (x - surfels[k, 0]) + surfels[k, 3] * (y - surfels[k, 1])
                known += 1
                inliers += r * r < limit * limit * spreads[i]
    return known, inliers


@compiled
def _surfels_in_view(surfels: F64, poses: F64, sweeps: Sweeps, reach: float, margin: float) -> tuple[int, int]:
    """`visible_agreement` added up over scans at their poses."""
    seen, contradicted = 0, 0
    for scan in range(len(poses)):
        some_seen, some_contradicted = visible_agreement(
            surfels,
            poses[scan],
            sweeps.T_robot_lasers[scan],
            sweeps.first_bearings[scan],
            sweeps.resolutions[scan],
            sweeps.ranges[sweeps.starts[scan] : sweeps.starts[scan + 1]],
            reach,
            margin,
        )
        seen += some_seen
        contradicted += some_contradicted
    return seen, contradicted


@compiled_for_both
def visible_agreement(
    surfels: F64,
    pose: F64,
    T_robot_laser: F64,
    first_bearing: float,
    resolution: float,
    ranges: F32,
    reach: float,
    margin: float,
) -> tuple[int, int]:
    """Count the surfels a scan taken at a pose should see: those where a beam ends, and those it looks through.

    Args:
        surfels: (n, 4) x, y and unit normal in the reference frame.
        pose: (3,) T_ref_robot.
        T_robot_laser: (3,) mount of the laser.
        first_bearing: of the first beam in the laser frame [rad].
        resolution: angle between two beams [rad].
        ranges: (n_beams,) [m], NaN without return.
        reach: surfels farther than this from the laser are not judged [m].
        margin: a beam that ends within this of a surfel sees it; when its own beam and both neighbours end farther
            behind it, it is contradicted [m].

    Returns:
        How many are seen and how many are contradicted.
    """
    c, s = cos(pose[2]), sin(pose[2])
    lx = pose[0] + c * T_robot_laser[0] - s * T_robot_laser[1]
    ly = pose[1] + s * T_robot_laser[0] + c * T_robot_laser[1]
    c, s = cos(pose[2] + T_robot_laser[2]), sin(pose[2] + T_robot_laser[2])
    seen, contradicted = 0, 0
    for k in range(len(surfels)):
        dx, dy = surfels[k, 0] - lx, surfels[k, 1] - ly
        if abs(dx) > reach or abs(dy) > reach:
            continue
        d = hypot(dx, dy)
        # Only surfaces that face the laser, and not too flat.
        if d < _NEAREST_JUDGED or d > reach or dx * surfels[k, 2] + dy * surfels[k, 3] > -_FLATTEST * d:
            continue
        turn = atan2(-s * dx + c * dy, c * dx + s * dy) - first_bearing
        if turn < 0.0:  # bearings may run beyond ±π
            turn += 2.0 * pi
        b = floor(turn / resolution + 0.5)
        if b < 1 or b >= len(ranges) - 1:
            continue
        behind, at = 0, 0
        for q in range(b - 1, b + 2):
            r = ranges[q]
            if np.isnan(r):
                continue
            if abs(r - d) <= margin:
                at += 1
            elif r > d:
                behind += 1
        if at > 0:
            seen += 1
        elif behind == 3:
            contradicted += 1
    return seen, contradicted
