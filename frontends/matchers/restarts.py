"""Other starts for iterations that ended badly, as Censi's own PLICP makes them."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.matchers.errors import require
from graph.se2 import compose


@dataclass(frozen=True, kw_only=True)
class RestartConfig:
    """When a matcher begins again elsewhere, and where."""

    below: float = 0.5
    """It begins again when less than this share of the points agrees with the reference; 0 never does."""
    sigmas: float = 1.5
    """New starts lie this many standard deviations of the guess from it …"""
    min_shift: float = 0.25
    """… but at least this far [m] …"""
    max_shift: float = 0.75
    """… and at most so far [m] …"""
    min_turn: float = 0.25
    """… turned by at least this [rad] …"""
    max_turn: float = 0.6
    """… and at most this [rad]."""

    def __post_init__(self) -> None:
        require(0 <= self.below <= 1, f"restarts.below must lie in [0, 1], found {self.below}")
        require(self.sigmas > 0, f"restarts.sigmas must be positive, found {self.sigmas}")
        require(0 < self.min_shift <= self.max_shift, "restarts: need 0 < min_shift <= max_shift")
        require(0 < self.min_turn <= self.max_turn, "restarts: need 0 < min_turn <= max_turn")


def other_starts(
    T_guess: NDArray[np.float64], covariance_guess: NDArray[np.float64], config: RestartConfig
) -> NDArray[np.float64]:
    """Starts around a guess: turned to either side, and shifted along either axis.

    Args:
        T_guess: (3,) the guess.
        covariance_guess: (3, 3) of it, tangent space there.
        config: how far.

    Returns:
        (6, 3) poses, those turned first.
    """
    shift = config.sigmas * math.sqrt(max(covariance_guess[0, 0], covariance_guess[1, 1]))
    turn = config.sigmas * math.sqrt(covariance_guess[2, 2])
    shift = min(max(shift, config.min_shift), config.max_shift)
    turn = min(max(turn, config.min_turn), config.max_turn)
    offsets = np.array([[0, 0, turn], [0, 0, -turn], [shift, 0, 0], [-shift, 0, 0], [0, shift, 0], [0, -shift, 0]])
    return compose(T_guess, offsets)
