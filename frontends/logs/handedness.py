"""Whether recorded headings turn with the scans or against them."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graph.se2 import wrap_angle

Handedness = Literal["left", "right", "unknown"]

_TURN = (np.radians(4.0), np.radians(40.0))
"""Turns between two scans that tell: more than the noise, less than the view [rad]."""
_MOVE = 0.5  # m: between the two scans
_AHEAD = 12  # scans
_PAIRS = 400
"""Most pairs of scans looked at."""
_LEAST_BEAMS = 20
"""Fewest readings that two scans must share to be compared."""
_LEAST_VOTES = 4
"""Fewest pairs that must tell left from right …"""
_MAJORITY = 0.8
"""… and the share of them that must agree."""
_CLEARLY = 0.7
"""A pair votes where one sign leaves less than this share of the difference that the other leaves."""


def handedness(
    poses: NDArray[np.float64], ranges: NDArray[np.float32], bearings: NDArray[np.float64]
) -> tuple[Handedness, int, int]:
    """Tell on which side positive headings lie.

    A robot that turns by Δθ sees at bearing b what it saw at b + Δθ before. Pairs of scans between which the heading
    changes and the place hardly does vote for the sign under which the readings agree.

    Args:
        poses: (n, 3) recorded at each scan.
        ranges: (n, n_beams) [m], NaN where nothing came back.
        bearings: (n_beams,) counter-clockwise positive, increasing [rad].

    Returns:
        "right" for headings that grow counter-clockwise, "left" for clockwise, "unknown" when too few pairs vote or
        they disagree; and the votes for left and for right.
    """
    votes = [0, 0]
    for first, second, turn in _pairs(poses):
        errors = [_disagreement(ranges[first], ranges[second], bearings, sign * turn) for sign in (-1.0, 1.0)]
        if np.isfinite(errors).all() and min(errors) < _CLEARLY * max(errors):
            votes[int(errors[1] < errors[0])] += 1
    left, right = votes
    if left + right < _LEAST_VOTES or max(left, right) < _MAJORITY * (left + right):
        return "unknown", left, right
    return ("left" if left > right else "right"), left, right


def _pairs(poses: NDArray[np.float64]) -> list[tuple[int, int, float]]:
    """Scans i < j and the recorded turn between them [rad], spread over the log."""
    found = []
    n = len(poses)
    taken = np.full(n, False)
    for ahead in range(1, min(_AHEAD, n - 1) + 1):
        turns = wrap_angle(poses[ahead:, 2] - poses[:-ahead, 2])
        moves = np.hypot(*(poses[ahead:, :2] - poses[:-ahead, :2]).T)
        good = (np.abs(turns) >= _TURN[0]) & (np.abs(turns) <= _TURN[1]) & (moves <= _MOVE) & ~taken[:-ahead]
        taken[:-ahead] |= good
        found += [(int(i), int(i) + ahead, float(turns[i])) for i in np.flatnonzero(good)]
    found.sort()
    return found[:: max(1, len(found) // _PAIRS)]


def _disagreement(
    first: NDArray[np.float32], second: NDArray[np.float32], bearings: NDArray[np.float64], turn: float
) -> float:
    """Median difference [m] of the readings of one place, if the robot turned by `turn`; NaN where too few overlap."""
    sought = bearings + turn
    inside = (sought >= bearings[0]) & (sought <= bearings[-1])
    step = (bearings[-1] - bearings[0]) / (len(bearings) - 1)
    there = np.rint((sought[inside] - bearings[0]) / step).astype(int).clip(0, len(bearings) - 1)
    differences = np.abs(second[inside] - first[there])
    differences = differences[np.isfinite(differences)]
    return float(np.median(differences)) if len(differences) >= _LEAST_BEAMS else float("nan")
