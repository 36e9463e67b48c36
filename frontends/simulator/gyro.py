"""What a gyro on the robot reports: its turn rate, scaled, biased and noisy, integrated from scan to scan."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.simulator.world import SimulatorError
from graph.ranges import check_between
from graph.se2 import wrap_angle

_SCALES, _RATES, _DENSITIES = (-1e4, 1e4), (-1e3, 1e3), (0.0, 1e3)


@dataclass(frozen=True, kw_only=True)
class GyroModel:
    """How wrong a gyro is.

    Attributes:
        scale: reported over true turn: 180/π of one that reports degrees, negative of one upside down.
        bias: turn rate that stands for standing still, true units [rad/s].
        noise: angle random walk: of the turn after one second [rad/√s].
        bias_walk: of the bias after one second [rad/s/√s].
    """

    scale: float = 1.0
    bias: float = math.radians(0.5)
    noise: float = math.radians(0.1)
    bias_walk: float = math.radians(0.003)

    def __post_init__(self) -> None:
        check_between(
            self,
            SimulatorError,
            "gyro.",
            scale=_SCALES,
            bias=_RATES,
            noise=_DENSITIES,
            bias_walk=_DENSITIES,
        )


def measure_turns(
    T_world_robot: NDArray[np.float64], model: GyroModel, period: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """What a gyro reports along a true path.

    Args:
        T_world_robot: (n, 3) true poses.
        model: scale, bias and noise.
        period: time between two poses [s].
        rng: the noise.

    Returns:
        (n, 3) turn rates integrated from the first pose on; only that about the vertical axis is not zero.
    """
    turns = wrap_angle(np.diff(T_world_robot[:, 2]))
    noise = rng.standard_normal((len(turns), 2)) * math.sqrt(period)
    bias = model.bias + np.cumsum(model.bias_walk * noise[:, 1])
    reported = model.scale * (turns + bias * period + model.noise * noise[:, 0])
    turned = np.zeros((len(T_world_robot), 3))
    turned[1:, 2] = np.cumsum(reported)
    return turned
