"""Steps that may be wrong and that no closure spans: nothing tells whether they are.

A robot that was carried to a place like the one it left matches there as well as ever, and nothing but its odometry
says that it is elsewhere: a slip looks the same. Nor does new ground tell whether the robot drove there or was carried.
What closures span they have decided; the rest is told. Where the robot may have been carried a few closures decide
nothing: they may be to places that are as much alike.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from iceg.slam.broken_path.bridge_edges import closures_across
from iceg.slam.broken_path.path_break import Break, FailureKind, Outcome, TrackingFailure
from iceg.slam.config import LoopClosureConfig
from iceg.slam.solution import Solution
from iceg.slam.track import Track

_FOLLOWED = (Outcome.JOINED, Outcome.DRIFTED)
"""Of these breaks the map follows the closures: that the path is wrong there is no doubt any more."""


def with_conflicts(
    solution: Solution, track: Track, failures: Mapping[int, TrackingFailure], config: LoopClosureConfig
) -> Solution:
    """Tell of steps that no closure spans: where match and odometry contradict each other, and who may be carried.

    Of a chain of steps that no closure spans the worst contradiction is told.

    Args:
        solution: all closures found, and the breaks of the path that are known; a chain that has one is told already.
        track: key scans.
        failures: by key pose, where the path may be broken.
        config: how many closures settle it.

    Returns:
        The solution with more breaks, in the order of the path, each with the probability that the robot was carried.
    """
    across = closures_across(solution.factors, len(track.keys), config)
    chain = np.cumsum(across > 0)  # the same all along steps that nothing spans
    unsettled = _unsettled(failures, across.tolist(), config)
    told, dead = {int(chain[found.key]) for found in solution.breaks}, track.keys_without_odometry()
    worst: dict[int, int] = {}
    for key in solution.odometry_jumps:
        failure, where = unsettled.get(key), int(chain[key])
        if failure is None or failure.kind is not FailureKind.INCONSISTENT or key in dead or where in told:
            continue
        if where not in worst or failure.distance2 > failures[worst[where]].distance2:
            worst[where] = key
    breaks = {found.key: found for found in solution.breaks}
    for key in worst.values():
        breaks[key] = Break(key=key, outcome=Outcome.CONFLICT, reason=failures[key].reason)
    for key, probability in _doubts(unsettled, config).items():
        found = breaks.get(key, Break(key=key, outcome=Outcome.DOUBTFUL, reason=failures[key].reason))
        if found.outcome not in _FOLLOWED:
            breaks[key] = replace(found, probability=max(found.probability, probability))
    return replace(solution, breaks=tuple(breaks[key] for key in sorted(breaks)))


def _doubts(failures: Mapping[int, TrackingFailure], config: LoopClosureConfig) -> dict[int, float]:
    """The probability that the robot was carried, by the first of the key poses that saw one change of the view."""
    found: dict[int, float] = {}
    first, last = 0, -config.view.keys - 1
    for key in sorted(failures):
        probability = failures[key].probability_carried
        if probability < config.failures.doubt:
            continue
        if key - last > config.view.keys:
            first = key
        last = key
        found[first] = max(probability, found.get(first, 0.0))
    return found


def _unsettled(
    failures: Mapping[int, TrackingFailure], across: list[int], config: LoopClosureConfig
) -> dict[int, TrackingFailure]:
    """The failures that too few closures span."""
    doubt = config.failures.doubt
    return {
        key: failure
        for key, failure in failures.items()
        if across[key] < (config.failures.settling_closures if failure.probability_carried >= doubt else 1)
    }
