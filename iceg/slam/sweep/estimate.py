"""How long a sweep of the laser takes and which way it goes, learned from how scans of one place fit together.

A scan that is taken while the robot turns is bent, the more the longer the sweep takes. Laid over one taken a little
earlier or later, with another turn or from another side, it fits best where both are straightened by the true sweep.
That is one unknown for the whole log: its least-squares solution, with the pose between each two scans eliminated,
needs neither truth nor odometry, and the scatter of the pairs tells its standard deviation (a sandwich estimate).
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from frontends.scan import Log
from graph.arrays import Float32s, Floats, Ints
from graph.noise import chi2_gate
from graph.se2 import between, compose, wrap_angle
from iceg.slam.sweep import _pair_kernels as kernels
from iceg.slam.sweep.deskew import in_laser_frame
from iceg.slam.sweep.motion import MotionWithin
from iceg.slam.sweep_config import SweepConfig

_MOST_ROUNDS = 12
_PROBE = 0.05
"""The first step is no shorter [intervals], to see how fast the gradient falls …"""
_LEAST_FALL = 0.1
"""… which is by no less than this share of what the points by themselves say."""
_CLOSE = 0.1
"""A step by less than so many standard deviations is the last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepEstimate:
    """What the scans say of the sweep.

    Attributes:
        share: time from the beam of the smallest bearing to the one of the largest, in usual intervals from scan to
            scan; negative where the laser turns clockwise.
        deviation: its standard deviation.
    """

    share: float
    deviation: float

    def is_significant(self, false_alarm: float) -> bool:
        """Whether chance explains it with a smaller probability only."""
        return abs(self.share) > _sigmas(false_alarm) * self.deviation


def learn_sweep(
    log: Log, T_map_robot: Floats, motion: MotionWithin, config: SweepConfig, least: float = 0.0
) -> SweepEstimate | None:
    """The sweep from the scans of a log, and a trajectory of their middles.

    Args:
        log: as recorded.
        T_map_robot: (n_scans, 3) trajectory, good over a metre.
        motion: (n_scans,) within each scan.
        config: how much is asked of the scans.
        least: a sweep shorter than this changes nothing [intervals], and need not be known well.

    Returns:
        The estimate; None where too few scans overlap, or none of them moves.
    """
    if len(log) < config.min_pairs or log.geometry.n_beams < config.min_points:
        return None
    quick = _solve(_Score.of(log, T_map_robot, motion, config, config.quick_scans, config.quick_points, 2), config)
    if quick is not None:
        doubt = _sigmas(config.quick_false_alarm) * quick.deviation
        if abs(quick.share) < doubt or abs(quick.share) + doubt < least:
            return quick
    return _solve(_Score.of(log, T_map_robot, motion, config, config.scans, config.points, 3), config)


def _sigmas(false_alarm: float) -> float:
    """Standard deviations that a normal error exceeds with this probability, to either side."""
    return math.sqrt(chi2_gate(false_alarm, freedom=1))


def _solve(score: "_Score", config: SweepConfig) -> SweepEstimate | None:
    """The sweep at which the gradient vanishes."""
    information, gradient, scatter = score.at(0.0)
    if information <= 0.0:
        return None
    share, step = 0.0, gradient / information
    step = math.copysign(max(abs(step), _PROBE), step)
    for _ in range(_MOST_ROUNDS):
        start, before = share, gradient
        share = min(max(share + step, -config.max_share), config.max_share)
        fitted, gradient, scatter = score.at(share)
        if fitted <= 0.0:
            return None
        if abs(share - start) >= 0.5 * _PROBE:
            # Points find other partners and poses follow: the gradient falls by less than the information says.
            information = min(fitted, max((before - gradient) / (share - start), _LEAST_FALL * fitted))
        step = gradient / information
        if abs(step) < _CLOSE * scatter / information:
            break
    return SweepEstimate(share=share, deviation=math.hypot(scatter / information, config.model_error * share))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Score:
    """Gradient and information of the sweep over pairs of scans."""

    ranges: Float32s
    pairs: Ints
    scan_of_pair: Ints
    T_one_other: Floats
    laser: kernels.Laser
    fit: kernels.Fit
    min_pairs: int

    @classmethod
    def of(
        cls,
        log: Log,
        T_map_robot: Floats,
        motion: MotionWithin,
        config: SweepConfig,
        scans: int,
        points: int,
        steps: int,
    ) -> "_Score":
        """Of so many scans, those that move most in as many parts of the log, and about so many points of each.

        The pose between two scans is found by so many Gauss-Newton steps.
        """
        geometry = log.geometry
        pairs, scan_of_pair = _pairs(T_map_robot, motion, scans, config)
        T_map_laser = compose(T_map_robot[pairs], geometry.T_robot_laser)
        velocity, change = in_laser_frame(motion, geometry)
        return cls(
            ranges=log.ranges,
            pairs=pairs,
            scan_of_pair=scan_of_pair,
            T_one_other=between(T_map_laser[:, 0], T_map_laser[:, 1]),
            laser=kernels.Laser(geometry.bearings, geometry.is_full_circle, velocity, change),
            fit=kernels.Fit(
                gate=config.gate,
                scale=config.scale,
                every=max(1, geometry.n_beams // points),
                half=max(2, round(math.radians(2.0) / geometry.resolution)),
                steps=steps,
                least=config.min_points,
            ),
            min_pairs=config.min_pairs,
        )

    def at(self, share: float) -> tuple[float, float, float]:
        """Information, gradient and standard deviation of the gradient with the sweep at `share`."""
        about = np.zeros((len(self.pairs), 2))
        kernels.reduced_information(self.ranges, self.pairs, self.T_one_other, self.laser, share, self.fit, about)
        if int(np.count_nonzero(about[:, 0])) < self.min_pairs:
            return 0.0, 0.0, 0.0
        gradients = np.bincount(self.scan_of_pair, weights=about[:, 1])
        mean = float(gradients.mean())
        return float(about[:, 0].sum()), float(gradients.sum()), math.sqrt(float(((gradients - mean) ** 2).sum()))


def _pairs(T_map_robot: Floats, motion: MotionWithin, scans: int, config: SweepConfig) -> tuple[Ints, Ints]:
    """(m, 2) scans to be laid over each other, and (m,) for which of the scans that are asked."""
    n = len(T_map_robot)
    speed = np.abs(motion.velocity[:, 2]) + config.bend_per_metre * np.hypot(
        motion.velocity[:, 0], motion.velocity[:, 1]
    )
    borders = np.linspace(0, n, min(scans, n) + 1).astype(np.int64).tolist()
    asked = np.array([a + int(np.argmax(speed[a:b])) for a, b in pairwise(borders)])
    moved = np.hypot(*np.diff(T_map_robot[:, :2], axis=0).T) / config.pair_distance
    turned = np.abs(wrap_angle(np.diff(T_map_robot[:, 2]))) / config.pair_turn
    way = np.concatenate([[0.0], np.cumsum(moved + turned)])
    before = np.searchsorted(way, way[asked] - 1.0, side="right") - 1
    after = np.searchsorted(way, way[asked] + 1.0)
    pairs = np.concatenate([np.stack([before, asked], axis=1), np.stack([after, asked], axis=1)])
    number = np.tile(np.arange(len(asked)), 2)
    inside = (pairs[:, 0] >= 0) & (pairs[:, 0] < n)
    return pairs[inside], number[inside]
