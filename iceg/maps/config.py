"""Settings of the maps; light to import, since the command line needs them before anything is computed."""

import math
from dataclasses import dataclass
from typing import Literal

from graph.errors import IcegError
from graph.limits import LIMITS, check_limit
from graph.ranges import check_between, check_numbers, shown_number
from graph.units import Radians


class GridError(IcegError):
    """A grid that cannot be rendered or written."""


class GridSizeError(GridError):
    """A grid that would be larger than allowed."""


_LEAST_CELL, _MOST_CELL = 1e-4, 1e5  # m
_FEWEST_CELLS = 16
"""Borders lie on multiples of the resolution and a cell is left free around: four by four hold any box, if large."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GridConfig:
    """How scans become an occupancy grid."""

    resolution: float = 0.05
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
    max_range: float = 20.0
    """Beams are used up to here [m]: free space before, returns within."""
    no_return_range: float = 0.0
    """How far a beam without return is taken as free [m]; 0: it says nothing."""
    beam_width: Radians | None = None
    """Full opening angle of a beam's cone [rad], at most the spacing of the beams; None: that spacing, they touch."""
    min_incidence: Radians = 0.2
    """Neighbouring returns lie on one surface unless it would be seen flatter than this [rad]."""
    min_travel: float = 0.1
    """Skip scans until the robot has moved this far since the last one used [m]; every scan when min_turn is 0 too. A
    robot that stands sees the same again and again: that is no new evidence, and a person beside it no wall."""
    min_turn: Radians = 0.1
    """Use a scan nevertheless once the robot has turned this much [rad]; 0: the turn does not matter."""
    max_cells: int = 150_000_000
    """Refuse grids larger than this (a diverged trajectory fills the memory); a run then doubles the resolution."""

    def __post_init__(self) -> None:
        if not _LEAST_CELL <= self.resolution <= _MOST_CELL:
            raise GridError(
                f"resolution is {self.resolution} m, expected a positive number from {_LEAST_CELL:g} to {_MOST_CELL:g}"
            )
        check_between(
            self,
            GridError,
            max_range=(0.0, LIMITS.range),
            beam_width=(0.0, 2.0 * math.pi),
            min_travel=(0.0, LIMITS.range),
            min_turn=(0.0, LIMITS.heading),
        )
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
        if not self.max_range > 0 or not 0 <= self.no_return_range <= self.max_range:
            raise GridError(
                f"max_range {self.max_range} m and no_return_range {self.no_return_range} m: "
                "expected 0 ≤ no return ≤ max, max > 0"
            )
        if not 0.0 < self.min_incidence < math.pi / 2:
            raise GridError(f"min_incidence is {self.min_incidence} rad, expected between 0 and π/2")
        if self.beam_width is not None and not self.beam_width > 0:
            raise GridError(f"beam_width is {self.beam_width} rad, expected > 0")
        if self.max_cells < _FEWEST_CELLS:
            raise GridError(f"max_cells is {self.max_cells}, expected at least {_FEWEST_CELLS}")
        check_limit(self.max_cells, "grid_cells", f"found max_cells {shown_number(self.max_cells)}")


class FeatureMapError(IcegError):
    """A feature map that cannot be built or placed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureMapConfig:
    """How features become landmarks, and when landmarks expire."""

    gate: float = 9.21
    """Largest squared Mahalanobis distance of a feature from its landmark (9.21: 99 % in two dimensions)."""
    max_distance: float = 0.35
    """Largest distance of a feature from its landmark, whatever the covariances say [m]."""
    max_angle: Radians = 0.35
    """Largest difference of corresponding wall directions [rad]."""
    pose_sigma: float = 0.03
    """Error of a key pose against another nearby, added to what is observed from it [m]."""
    heading_sigma: Radians = 0.01
    """Error of the heading of a key pose against another nearby [rad]."""
    drift_sigma: float = 0.005
    """A landmark's point depends on where it is seen from: its standard deviation grows by this at each update [m]."""
    landmark_range: float = 15.0
    """Features farther than this from the laser do not become landmarks [m]."""
    landmark_sigma: float = 0.2
    """Features less certain than this along x or y do not become landmarks [m]."""
    visible_range: float = 8.0
    """Farther landmarks are not expected to be seen [m]."""
    occlusion_margin: float = 0.2
    """A beam that ends this much before a landmark occludes it [m]."""
    edge_on: Radians = 0.2
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
        for name in ("gate", "max_distance", "max_angle", "landmark_range", "landmark_sigma", "visible_range"):
            if not getattr(self, name) > 0:
                raise FeatureMapError(f"{name} is {getattr(self, name)}, expected > 0")
        check_numbers(self, FeatureMapError)
        check_between(self, FeatureMapError, edge_on=(0.0, math.pi / 2.0), drift_sigma=(0.0, 1000.0))
        if not 0.0 < self.false_detection_probability < self.detection_probability < 1.0:
            raise FeatureMapError(
                f"false_detection_probability {self.false_detection_probability} and detection_probability "
                f"{self.detection_probability}: expected 0 < false < true < 1"
            )
        if not 0.0 < self.expiry < 0.5 < self.longest_memory < 1.0:
            raise FeatureMapError(
                f"expiry {self.expiry} and longest_memory {self.longest_memory}: expected 0 < expiry < 0.5 < memory < 1"
            )
