"""Where the axes of the map lie: turned so that walls are upright, its origin set."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graph.elementary import arctan2, cos_sin
from graph.se2 import compose
from iceg.corrections.corrections import MapFrame
from iceg.ice.config import SegmentConfig
from iceg.ice.segments import extract_segments
from iceg.slam.joint.wall_pieces import WallPieces
from iceg.slam.solution import Solution
from iceg.slam.track import Track

_LOOKED_AT = 400
"""Key scans whose walls are asked, spread over the path."""


def in_frame(
    frame: MapFrame, solution: Solution, walls: WallPieces, track: Track, config: SegmentConfig
) -> tuple[Solution, WallPieces]:
    """A solution and its walls in the frame of the map that is asked for; of the factors only priors know of frames.

    Args:
        frame: what is asked for; scans counted as the track counts them.
        solution: the graph and its key poses.
        walls: as the joint refinement found them.
        track: key scans.
        config: of the straight segments whose direction makes a map upright.
    """
    if frame.is_as_found:
        return solution, walls
    T_new_map = _transform(frame, track, solution.poses, config)
    poses = compose(T_new_map, solution.poses)
    factors = [
        factor.measuring(compose(T_new_map, factor.T_i_j)) if factor.i is None else factor
        for factor in solution.factors
    ]
    return replace(solution, factors=factors, poses=poses), walls.moved(T_new_map)


def walls_heading(track: Track, key_poses: NDArray[np.float64], config: SegmentConfig) -> float:
    """By how much the walls of a map are turned from its axes [rad], in [−π/4, π/4]; 0 where no wall is seen.

    The mean direction of all segments, each by its length, on the circle on which a quarter turn is a whole one.
    """
    every = max(1, len(track.keys) // _LOOKED_AT)
    total = np.zeros(2)
    for key in range(0, len(track.keys), every):
        walls = extract_segments(track.keys[key].scan, config)
        along = walls.endpoints[:, 1] - walls.endpoints[:, 0]
        lengths = np.hypot(along[:, 0], along[:, 1])
        cosines, sines = cos_sin(4.0 * (walls.headings + key_poses[key, 2]))
        total += [float((lengths * cosines).sum()), float((lengths * sines).sum())]
    return 0.25 * float(arctan2(total[1], total[0])) if total.any() else 0.0


def _transform(
    frame: MapFrame, track: Track, key_poses: NDArray[np.float64], config: SegmentConfig
) -> NDArray[np.float64]:
    """(3,) T_new_map: what moves the map as it was found into the frame asked for."""
    turn = math.radians(frame.turn_degrees) - (walls_heading(track, key_poses, config) if frame.upright else 0.0)
    origin = np.zeros(3)
    if frame.origin is not None:
        origin[:2] = frame.origin
    elif frame.origin_scan is not None:
        key = track.key_of_scan[frame.origin_scan]
        origin[:2] = compose(key_poses[key], track.T_key_scan[frame.origin_scan])[:2]
    return compose(np.array([0.0, 0.0, turn]), -origin)
