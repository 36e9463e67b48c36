"""What it means for the covariances that a match contradicted odometry, and little tells which was right.

The graph believes the match there, since odometry jumps and slips. Yet matches are wrong, too: past a door with a
laser of short reach, after a turn between two scans, among people. What follows then hangs on a turn that nobody made,
and of the few closures that span it some were found only because it leads there. Until several closures have come
that way, a match that does not explain its scan well, or leaves a direction open, is no more credible than the
odometry. The covariances have room for both.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graph.dense import matvec
from graph.factors import Factor
from graph.measurement import NoMatch
from graph.se2 import adjoint, between, compose, logmap
from iceg.slam.back_end import Solution
from iceg.slam.broken_path.untied_steps import amid_the_path, closures_across
from iceg.slam.config import LoopClosureConfig
from iceg.slam.tracking.track import KeyScan, Track

_SETTLED = 6
"""So many closures that span such a step settle it, as so many must agree to join the parts of a broken path."""
_TELLING = 0.8
"""A match of a higher score, which observes all directions, is believed: odometry has jumped or slipped."""
_ODOMETRY = 0.5
"""How probable it is that odometry was right."""


def with_both_ways(covariances: NDArray[np.float64], ways: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariances of the key poses that allow for odometry where a match that is in doubt contradicted it.

    Args:
        covariances: (k, 3, 3) of the key poses relative to the first, if the matches were right.
        ways: (r, k, 3) how far the other way leads, see `other_ways`.

    Returns:
        (k, 3, 3) second moments about the poses of both ways together.
    """
    widened = covariances.copy()
    for moved in ways:
        widened += moved[:, :, None] * moved[:, None, :]
    return widened


def other_ways(
    solution: Solution, factors: Sequence[Factor], track: Track, config: LoopClosureConfig
) -> NDArray[np.float64]:
    """Where odometry would lead that a match in doubt contradicted.

    Args:
        solution: the poses, where a match contradicted odometry, and what closures made of it.
        factors: of the graph, as they were measured.
        track: key scans and their matches.
        config: on which key scans closures rest.

    Returns:
        (r, k, 3) for each such step how far it moves each of the k key poses, tangent space at it, times the square
        root of the probability that odometry was right: 0 before the step, and one rigid motion of all behind it.
    """
    poses, amid = solution.poses, amid_the_path(track)
    across = closures_across(factors, len(poses), config)
    joined = {found.key for found in solution.breaks if found.outcome == "joined"}
    claims = {factor.j: factor.T_i_j for factor in factors if factor.kind == "odometry" and factor.i == factor.j - 1}
    unsettled = [
        key
        for key in solution.odometry_jumps
        if amid[key] and across[key] < _SETTLED and key in claims and key not in joined
    ]
    # One wrong match brings the next: those in a row are judged together.
    doubtful = [row for row in _in_a_row(unsettled) if any(_is_in_doubt(track.keys[key]) for key in row)]
    ways = np.zeros((len(doubtful), len(poses), 3))
    for way, row in zip(ways, doubtful, strict=True):
        claimed = np.zeros(3)
        for key in row:
            claimed = compose(claimed, claims[key])
        before, last = row[0] - 1, row[-1]
        apart = logmap(between(between(poses[before], poses[last]), claimed))
        way[row[0] :] = math.sqrt(_ODOMETRY) * matvec(adjoint(between(poses[row[0] :], poses[last])), apart)
    return ways


def _is_in_doubt(key: KeyScan) -> bool:
    match = key.match
    return isinstance(match, NoMatch) or match.score < _TELLING or not match.is_fully_observed


def _in_a_row(keys: Sequence[int]) -> list[list[int]]:
    """Increasing numbers, those that follow each other together."""
    rows: list[list[int]] = []
    for key in keys:
        if rows and key == rows[-1][-1] + 1:
            rows[-1].append(key)
        else:
            rows.append([key])
    return rows
