"""Settings of the maps; light to import, since the command line needs them before anything is computed."""

import math
from dataclasses import dataclass
from typing import Literal

from graph.errors import IcegError
from graph.limits import LIMITS, check_limit
from graph.ranges import CheckedSettings, between, positive, shown_number
from graph.units import Radians


class GridError(IcegError):
    """A grid that cannot be rendered or written."""


class GridSizeError(GridError):
    """A grid that would be larger than allowed."""


_LEAST_CELL, _MOST_CELL = 1e-4, 1e5  # m
_FEWEST_CELLS = 16
"""Borders lie on multiples of the resolution and a cell is left free around: four by four hold any box, if large."""


@dataclass(frozen=True, kw_only=True)
class GridConfig(CheckedSettings, error=GridError):
    """How scans become an occupancy grid."""

    resolution: float = between(0.05, _LEAST_CELL, _MOST_CELL)
    """Side of a cell [m]."""
    mode: Literal["probabilistic", "binary"] = "probabilistic"
    """probabilistic: evidence adds up in log-odds. binary: the latest observation of a cell decides."""
    hit_probability: float = 0.7
    """Probability of a cell being occupied after one return from it alone; a wider footprint shares the evidence."""
    miss_probability: float = 0.44
    """Probability of a cell being occupied after one beam through it. Nearer to a half than a return's: of a wall on
    the border of two cells, each is hit by some scans and passed through by others."""
    clamp_probability: float = 0.97
    """Log-odds are clamped to ± those of this probability, so that the map can change its mind."""
    occupied_above: float = 0.6
    """A cell counts as occupied above this probability."""
    free_below: float = 0.45
    """A cell counts as free below this probability; between the two it is unknown."""
    max_range: float = positive(20.0, most=LIMITS.range)
    """Beams are used up to here [m]: free space before, returns within."""
    no_return_range: float = 0.0
    """How far a beam without return is taken as free [m]; 0: it says nothing."""
    beam_width: Radians | None = None
    """Full opening angle of a beam's cone [rad], at most the spacing of the beams; None: that spacing, they touch."""
    min_incidence: Radians = positive(0.2, most=0.5 * math.pi)
    """Neighbouring returns lie on one surface unless it would be seen flatter than this [rad]."""
    min_travel: float = between(0.1, 0.0, LIMITS.range)
    """Skip scans until the robot has moved this far since the last one used [m]; every scan when min_turn is 0 too. A
    robot that stands sees the same again and again: that is no new evidence, and a person beside it no wall."""
    min_turn: Radians = between(0.1, 0.0, LIMITS.heading)
    """Use a scan nevertheless once the robot has turned this much [rad]; 0: the turn does not matter."""
    max_cells: int = 150_000_000
    """Refuse grids larger than this (a diverged trajectory fills the memory); a run then doubles the resolution."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.miss_probability < 0.5 < self.hit_probability < 1.0:
            raise GridError(
                f"miss_probability {self.miss_probability} and hit_probability {self.hit_probability}: "
                "expected 0 < miss < 0.5 < hit < 1"
            )
        if not self.hit_probability <= self.clamp_probability < 1.0:
            raise GridError(f"clamp_probability is {self.clamp_probability}, expected hit_probability ≤ it < 1")
        if not 0.0 < self.free_below <= 0.5 <= self.occupied_above < 1.0:
            raise GridError(
                f"free_below {self.free_below} and occupied_above {self.occupied_above}: "
                "expected 0 < free ≤ 0.5 ≤ occupied < 1"
            )
        if self.no_return_range > self.max_range:
            raise GridError(
                f"no_return_range is {self.no_return_range} m, expected at most max_range, {self.max_range} m"
            )
        if self.beam_width is not None and not 0.0 < self.beam_width <= 2.0 * math.pi:
            raise GridError(f"beam_width is {self.beam_width} rad, expected more than 0 and at most 2π")
        if self.max_cells < _FEWEST_CELLS:
            raise GridError(f"max_cells is {self.max_cells}, expected at least {_FEWEST_CELLS}")
        check_limit(self.max_cells, "grid_cells", f"found max_cells {shown_number(self.max_cells)}")


class FeatureMapError(IcegError):
    """A feature map that cannot be built or placed."""


@dataclass(frozen=True, kw_only=True)
class FeatureMapConfig(CheckedSettings, error=FeatureMapError):
    """How features become landmarks, and when landmarks expire."""

    gate: float = positive(9.21)
    """Largest squared Mahalanobis distance of a feature from its landmark (9.21: 99 % in two dimensions)."""
    max_distance: float = positive(0.35)
    """Largest distance of a feature from its landmark, whatever the covariances say [m]."""
    max_angle: Radians = positive(0.35)
    """Largest difference of corresponding wall directions [rad]."""
    pose_sigma: float = 0.03
    """Error of a key pose against another nearby, added to what is observed from it [m]."""
    heading_sigma: Radians = 0.01
    """Error of the heading of a key pose against another nearby [rad]."""
    drift_sigma: float = between(0.005, 0.0, 1000.0)
    """A landmark's point depends on where it is seen from: its standard deviation grows by this at each update [m]."""
    landmark_range: float = positive(15.0)
    """Features farther than this from the laser do not become landmarks [m]."""
    landmark_sigma: float = positive(0.2)
    """Features less certain than this along x or y do not become landmarks [m]."""
    visible_range: float = positive(8.0)
    """Farther landmarks are not expected to be seen [m]."""
    occlusion_margin: float = 0.2
    """A beam that ends this much before a landmark occludes it [m]."""
    edge_on: Radians = between(0.2, 0.0, 0.5 * math.pi)
    """Walls seen under a flatter angle are not expected to be seen [rad]."""
    detection_probability: float = 0.3
    """Probability that a landmark in the visible area is seen while it is there."""
    false_detection_probability: float = 0.05
    """Probability that something is taken for a landmark although it is gone."""
    longest_memory: float = 0.98
    """The probability of a landmark's existence never exceeds this, so that it can be forgotten."""
    expiry: float = 0.12
    """A landmark expires when the probability of its existence falls below this (it starts at 0.5)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.false_detection_probability < self.detection_probability < 1.0:
            raise FeatureMapError(
                f"false_detection_probability {self.false_detection_probability} and detection_probability "
                f"{self.detection_probability}: expected 0 < false < true < 1"
            )
        if not 0.0 < self.expiry < 0.5 < self.longest_memory < 1.0:
            raise FeatureMapError(
                f"expiry {self.expiry} and longest_memory {self.longest_memory}: expected 0 < expiry < 0.5 < memory < 1"
            )
