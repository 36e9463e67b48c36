"""Compiled loops that ask where a scan and the reference contradict each other: beams through what the other saw."""

from math import atan2, cos, floor, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both
from iceg.ice.sweeps import Sweeps

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I8 = NDArray[np.int8]
Bool = NDArray[np.bool_]

UNSEEN, SEEN, SEEN_THROUGH = 0, 1, 2

_NEAREST = 0.3
"""What is nearer to the laser than this is not judged [m] …"""
_FLATTEST = 0.05
"""… nor what is seen at a flatter angle than this (cosine between beam and normal)."""


@compiled
def _place(
    px: float,
    py: float,
    nx: float,
    ny: float,
    pose: tuple[float, float, float, float],
    first_bearing: float,
    resolution: float,
    n_beams: int,
    reach: float,
) -> tuple[int, float, float]:
    """Beam that points at a surface, its distance, and the cosine of incidence; beam -1 where it cannot be judged.

    The pose of the laser is its position and the cosine and sine of its heading. A surface without a normal (0, 0) is
    taken to face the laser.
    """
    lx, ly, c, s = pose
    dx, dy = px - lx, py - ly
    if abs(dx) > reach or abs(dy) > reach:
        return -1, 0.0, 1.0
    distance = hypot(dx, dy)
    if distance < _NEAREST or distance > reach:
        return -1, distance, 1.0
    facing = 1.0 if nx == 0.0 and ny == 0.0 else -(dx * nx + dy * ny) / distance
    if facing < _FLATTEST:
        return -1, distance, 1.0
    turn = atan2(-s * dx + c * dy, c * dx + s * dy) - first_bearing
    if turn < 0.0:  # bearings may run beyond ±π
        turn += 2.0 * pi
    beam = floor(turn / resolution + 0.5)
    if beam < 1 or beam >= n_beams - 1:
        return -1, distance, facing
    return beam, distance, facing


@compiled
def _verdict(ranges: F32, beam: int, distance: float, margin: float) -> int:
    """Whether a beam or its neighbours end at a distance, or all three go on behind it."""
    behind, at = 0, 0
    for q in range(beam - 1, beam + 2):
        if abs(ranges[q] - distance) <= margin:
            at += 1
        elif ranges[q] > distance:
            behind += 1
    if at > 0:
        return SEEN
    return SEEN_THROUGH if behind == 3 else UNSEEN


@compiled
def _laser(T_ref_robot: F64, T_robot_laser: F64) -> tuple[float, float, float, float]:
    """Position of the laser, cosine and sine of its heading."""
    c, s = cos(T_ref_robot[2]), sin(T_ref_robot[2])
    turn = T_ref_robot[2] + T_robot_laser[2]
    return (
        T_ref_robot[0] + c * T_robot_laser[0] - s * T_robot_laser[1],
        T_ref_robot[1] + s * T_robot_laser[0] + c * T_robot_laser[1],
        cos(turn),
        sin(turn),
    )


@compiled
def beams_through(
    surfels: F64,
    T_ref_robot: F64,
    T_robot_laser: F64,
    first_bearing: float,
    resolution: float,
    ranges: F32,
    reach: float,
    margin: float,
    across: float,
    cell: float,
    through: Bool,
) -> int:
    """Count the beams of a scan that pass through the reference.

    Args:
        surfels: (n, 4) x, y and unit normal in the reference frame.
        T_ref_robot: (3,) pose the scan was taken at.
        T_robot_laser: (3,) mount of the laser.
        first_bearing: of the first beam in the laser frame [rad].
        resolution: angle between two beams [rad].
        ranges: (n_beams,) [m], NaN without return.
        reach: surfels farther than this from the laser are not judged [m].
        margin: a beam passes a surfel only if it and both neighbours end farther than this behind it [m] …
        across: … and farther than this measured across its surface [m].
        cell: width of a surfel [m].
        through: (n_beams,) output.

    Returns:
        How many.
    """
    through[:] = False
    laser = _laser(T_ref_robot, T_robot_laser)
    n_beams, count = len(ranges), 0
    for k in range(len(surfels)):
        beam, distance, facing = _place(
            surfels[k, 0], surfels[k, 1], surfels[k, 2], surfels[k, 3], laser, first_bearing, resolution, n_beams, reach
        )
        if beam < 0:
            continue
        allowed = max(margin, across / facing)
        if _verdict(ranges, beam, distance, allowed) != SEEN_THROUGH:
            continue
        half = floor(0.5 * cell * facing / (distance * resolution) + 0.5)
        for q in range(max(0, beam - half), min(n_beams, beam + half + 1)):
            if ranges[q] > distance + allowed and not through[q]:
                through[q] = True
                count += 1
    return count


@compiled_for_both
def judge_points(
    points: F64,
    normals: F64,
    every: int,
    T_ref_cur: F64,
    T_ref_robot: F64,
    T_robot_laser: F64,
    first_bearing: float,
    resolution: float,
    ranges: F32,
    reach: float,
    margin: float,
    across: float,
    verdicts: I8,
) -> None:
    """Judge the points of one scan by the beams of another, taken at `T_ref_robot`.

    Args:
        points: (n, 2) in the robot frame of their scan [m].
        normals: (n, 2); 0, 0 where unknown.
        every: only every so many points are judged.
        T_ref_cur: (3,) pose of their scan.
        T_ref_robot: (3,) pose of the other, whose laser, beams and ranges the following arguments are.
        T_robot_laser: see `beams_through`, as the following.
        first_bearing: …
        resolution: …
        ranges: …
        reach: …
        margin: …
        across: …
        verdicts: (n,) changed in place: SEEN where a beam ends, else SEEN_THROUGH where beams end behind the point;
            what an earlier scan has seen stays seen.
    """
    laser = _laser(T_ref_robot, T_robot_laser)
    c, s = cos(T_ref_cur[2]), sin(T_ref_cur[2])
    n_beams = len(ranges)
    for i in range(0, len(points), every):
        if verdicts[i] == SEEN:
            continue
        beam, distance, facing = _place(
            T_ref_cur[0] + c * points[i, 0] - s * points[i, 1],
            T_ref_cur[1] + s * points[i, 0] + c * points[i, 1],
            c * normals[i, 0] - s * normals[i, 1],
            s * normals[i, 0] + c * normals[i, 1],
            laser,
            first_bearing,
            resolution,
            n_beams,
            reach,
        )
        if beam < 0:
            continue
        verdict = _verdict(ranges, beam, distance, max(margin, across / facing))
        if verdict != UNSEEN:
            verdicts[i] = verdict


@compiled
def judge_points_by_all(
    points: F64,
    normals: F64,
    every: int,
    T_ref_cur: F64,
    sweeps: Sweeps,
    reach: float,
    margin: float,
    across: float,
    verdicts: I8,
) -> int:
    """`judge_points` by the beams of one scan after the other; return how many points are seen through in the end.

    Args:
        points: see `judge_points`, as the following.
        normals: …
        every: …
        T_ref_cur: …
        sweeps: beams and poses of the others.
        reach: see `judge_points`, as the following.
        margin: …
        across: …
        verdicts: (n,) output.
    """
    verdicts[:] = UNSEEN
    for k in range(len(sweeps.T_ref_robots)):
        judge_points(
            points,
            normals,
            every,
            T_ref_cur,
            sweeps.T_ref_robots[k],
            sweeps.T_robot_lasers[k],
            sweeps.first_bearings[k],
            sweeps.resolutions[k],
            sweeps.ranges[sweeps.starts[k] : sweeps.starts[k + 1]],
            reach,
            margin,
            across,
            verdicts,
        )
    count = 0
    for verdict in verdicts:
        count += 1 if verdict == SEEN_THROUGH else 0
    return count
