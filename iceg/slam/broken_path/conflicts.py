"""Steps at which match and odometry contradict each other and that no closure spans: nothing tells which is right.

A robot that was carried to a place like the one it left matches there as well as ever, and nothing but its odometry
says that it is elsewhere: a slip looks the same. What closures span they have decided; the rest is told. Where besides
what the laser sees changed at once a few closures decide nothing: they may be to places that are as much alike.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from iceg.slam.broken_path.bridge_edges import closures_across
from iceg.slam.broken_path.path_break import Break, FailureKind, Outcome, TrackingFailure
from iceg.slam.config import LoopClosureConfig
from iceg.slam.solution import Solution
from iceg.slam.track import Track


def with_conflicts(
    solution: Solution, track: Track, failures: Mapping[int, TrackingFailure], config: LoopClosureConfig
) -> Solution:
    """Tell, of each stretch of the path that no closure spans, where match and odometry contradict each other most.

    Args:
        solution: all closures found, and the breaks of the path that are known; a stretch that has one is told already.
        track: key scans.
        failures: by key pose, where the path may be broken.
        config: how near to the ends of the path it matters to nobody, and how many closures settle it.

    Returns:
        The solution with more breaks, in the order of the path.
    """
    path, end = track.path, config.failures.log_end
    across = closures_across(solution.factors, len(path), config)
    stretch = np.cumsum(across > 0)  # the same all along steps that nothing spans
    told, dead = {int(stretch[found.key]) for found in solution.breaks}, track.keys_without_odometry()
    worst: dict[int, int] = {}
    for key in solution.odometry_jumps:
        failure, where = failures.get(key), int(stretch[key])
        if failure is None or failure.kind is not FailureKind.INCONSISTENT or key in dead or where in told:
            continue
        if across[key] >= (config.failures.settling_closures if failure.is_carried else 1):
            continue
        known = worst.get(where)
        if end < path[key] < path[-1] - end and (known is None or failure.distance2 > failures[known].distance2):
            worst[where] = key
    found = [Break(key=key, outcome=Outcome.CONFLICT, reason=failures[key].reason) for key in worst.values()]
    return replace(solution, breaks=tuple(sorted([*solution.breaks, *found], key=lambda each: each.key)))
