"""What a match may be off because something else holds it than what holds the map there.

A chair leg, the edge of a door or a person's back holds a match along a corridor as well as a wall across it would, by
the scores: a few points, each as sure as any. But so little may belong to something else, and then the scan lies where
something similar was within reach of the guess. Two things tell: how much wall holds the match, and how far it lies
from where the robot was expected.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graph.measurement import RelativePose
from graph.se2 import between
from iceg.ice.config import FalseMatchConfig


def allowing_for_chance(
    match: RelativePose,
    T_ref_expected: NDArray[np.float64],
    covariance: NDArray[np.float64],
    config: FalseMatchConfig,
    *,
    is_measured: bool,
) -> RelativePose:
    """A match with the variance of what it may be off because something else holds it.

    Along either direction it is right, or something else holds it, or odometry is wrong; what lies between the two
    tells how probable each is. The mixture becomes one Gaussian of the same variance.

    Args:
        match: of a matcher that tells what holds it.
        T_ref_expected: (3,) pose by odometry, or for want of it by the velocity …
        covariance: (3, 3) … and how well it is known, tangent space of the robot.
        config: how probable what is.
        is_measured: whether odometry tells all of the way; a velocity that is taken to last may be wrong by anything.

    Returns:
        The match, less sure along what little holds. One that does not observe a direction stays as it is.
    """
    held = match.held
    if held is None or not match.is_fully_observed:
        return match
    dx, dy, _ = between(match.T_ref_cur, T_ref_expected).tolist()
    allowing, slides = match.covariance.copy(), []
    for direction, length in zip(held.directions, held.lengths.tolist(), strict=True):
        x, y, _ = direction.tolist()
        ours, theirs = (_variance(x, y, which) for which in (match.covariance, covariance))
        share = max(length, 0.0) / config.length
        doubt = 1.0 / (1.0 + share * share * share * share)
        if is_measured:
            added = _probably_false(x * dx + y * dy, ours, theirs, doubt, config) * config.distance**2
        else:
            added = config.similar_per_metre * theirs * math.sqrt(theirs) * doubt
        allowing += added * np.outer(direction, direction)
        if added > config.unobserved**2:
            slides.append(direction / math.sqrt(float((direction**2).sum())))
    return replace(match, covariance=allowing, weak_directions=np.array(slides).reshape(-1, 3))


def _probably_false(offset: float, ours: float, theirs: float, doubt: float, config: FalseMatchConfig) -> float:
    """The probability that a match is false that lies so far from where odometry has the robot [m], by Bayes.

    Args:
        offset: of odometry along the direction.
        ours: variance of the match along it [m²].
        theirs: that of odometry.
        doubt: how much of `config.probability` remains for what the match is held by.
        config: how probable what is.
    """
    before = config.probability * doubt
    false = before * _normal(offset, theirs + config.distance**2)
    slipped = 1.0 / (math.pi * config.distance * (1.0 + (offset / config.distance) ** 2))
    right = (1.0 - before) * ((1.0 - config.slip) * _normal(offset, ours + theirs) + config.slip * slipped)
    return false / (false + right)


def _normal(offset: float, variance: float) -> float:
    """Density of a Gaussian with mean zero."""
    return math.exp(-0.5 * offset**2 / variance) / math.sqrt(2.0 * math.pi * variance)


def _variance(x: float, y: float, covariance: NDArray[np.float64]) -> float:
    """Of the position along (x, y), of a (3, 3) covariance."""
    (xx, xy, _), (_, yy, _), _ = covariance.tolist()
    return float(x * x * xx + 2.0 * x * y * xy + y * y * yy)
