"""Relative poses implied by pairs of features that pass the hierarchy of filters (paper, section III.C.2)."""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from iceg.ice import _hypothesis_kernels as kernels
from iceg.ice.config import HypothesisConfig
from iceg.ice.features import FeatureRows

_CAPACITY = 6000
"""Most hypotheses of one match."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchWindow:
    """The feasible area: how far from the guess the robot may be.

    Attributes:
        T_ref_guess: (3,) centre.
        translation: half-width in x and y of the reference frame [m].
        rotation: half-width in heading [rad].
    """

    T_ref_guess: NDArray[np.float64]
    translation: float
    rotation: float

    def contains(self, T_ref_cur: NDArray[np.float64]) -> bool:
        """Whether a (3,) pose lies in it, a tenth of its width forgiven."""
        offsets: list[float] = (T_ref_cur - self.T_ref_guess).tolist()
        dx, dy, turn = offsets
        farthest = max(abs(dx), abs(dy))
        return farthest <= 1.1 * self.translation and abs((turn + pi) % (2 * pi) - pi) <= 1.1 * self.rotation


def search_window(
    T_ref_guess: NDArray[np.float64], covariance: NDArray[np.float64], config: HypothesisConfig
) -> SearchWindow:
    """The window that holds the truth at the configured number of standard deviations.

    Args:
        T_ref_guess: (3,) the guess.
        covariance: (3, 3) of the guess, tangent space, order x, y, θ.
        config: number of standard deviations and smallest window.

    Returns:
        The window.
    """
    largest = max(float(covariance[0, 0]), float(covariance[1, 1]))
    return SearchWindow(
        T_ref_guess=T_ref_guess,
        translation=max(config.min_window, config.sigmas * largest**0.5),
        rotation=min(pi, max(config.min_turn, config.sigmas * float(covariance[2, 2]) ** 0.5)),
    )


def widened(window: SearchWindow, config: HypothesisConfig) -> SearchWindow:
    """The window of a second try, when odometry must have jumped."""
    return SearchWindow(
        T_ref_guess=window.T_ref_guess,
        translation=max(window.translation, config.wide_window),
        rotation=max(window.rotation, config.wide_turn),
    )


def pair_hypotheses(
    features: FeatureRows, reference: FeatureRows, window: SearchWindow, config: HypothesisConfig
) -> NDArray[np.float64]:
    """Every compatible pair of a new and a reference feature gives one relative pose by geometry alone.

    Args:
        features: features of the new scan, robot frame.
        reference: features of the local map, reference frame.
        window: the feasible area.
        config: gates.

    Returns:
        (n, 3) hypotheses for T_ref_cur; the guess itself is the first.
    """
    out = np.empty((_CAPACITY, 3))
    out[0] = window.T_ref_guess
    count = kernels.pair_hypotheses(
        features.kinds,
        features.rows,
        reference.kinds,
        reference.rows,
        window.T_ref_guess,
        window.translation,
        window.rotation,
        config.opening_gate,
        out[1:],
    )
    return out[: count + 1]


def distinct(
    hypotheses: NDArray[np.float64],
    order: NDArray[np.int64],
    wanted: int,
    separation_m: float = 0.25,
    separation_rad: float = 0.1,
) -> list[int]:
    """The first hypotheses in an order that differ from each other.

    Args:
        hypotheses: (n, 3) poses.
        order: (k,) indices of those to choose from, the best first.
        wanted: how many at most.
        separation_m: two differ that lie farther apart [m] …
        separation_rad: … or are turned by more [rad].

    Returns:
        Their indices in that order.
    """
    chosen = np.empty(wanted, np.int64)
    count = kernels.distinct(hypotheses, order, separation_m, separation_rad, chosen)
    indices: list[int] = chosen[:count].tolist()
    return indices
