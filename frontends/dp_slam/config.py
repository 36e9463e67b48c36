"""Settings of DP-SLAM; the defaults are those of its authors' release 0.1.1."""

import math
from dataclasses import dataclass, field, fields

from graph.errors import IcegError
from graph.limits import LIMITS, check_limit
from graph.ranges import check_between, check_magnitudes, shown_number
from graph.units import Radians


class DpSlamError(IcegError):
    """A setting of DP-SLAM outside its range, or a log it cannot work on."""


@dataclass(frozen=True, kw_only=True)
class MotionModel:
    """What the wheels' report of a step says about the motion (Eliazar and Parr, ICML 2004).

    A step is D along the mean heading, C to the left of it and a turn T. The mean of each is linear in the reported
    distance and turn; so are the standard deviations, in their magnitudes, with a floor.
    """

    d_per_metre: float = 1.0
    """Metres forwards per metre reported."""
    d_per_radian: float = 0.0
    """Metres forwards per radian reported [m/rad]."""
    c_per_metre: float = 0.0
    """Metres to the left per metre reported, besides what is reported there."""
    c_per_radian: float = 0.0
    """Metres to the left per radian reported [m/rad]."""
    t_per_metre: float = 0.0
    """Turn per metre reported [rad/m]."""
    t_per_radian: float = 1.0
    """Turn per radian reported."""
    d_std_per_metre: float = 0.156
    """Standard deviation forwards per metre reported."""
    d_std_per_radian: float = 0.0569
    """Standard deviation forwards per radian reported [m/rad]."""
    c_std_per_metre: float = 0.063
    """Standard deviation to the left per metre reported."""
    c_std_per_radian: float = 0.0657
    """Standard deviation to the left per radian reported [m/rad]."""
    t_std_per_metre: float = 0.028
    """Standard deviation of the turn per metre reported [rad/m]."""
    t_std_per_radian: float = 0.1405
    """Standard deviation of the turn per radian reported."""
    floor: float = 0.0229
    """Least standard deviation of a step forwards and to the left [m]."""
    turn_floor: Radians = 0.1
    """Least standard deviation of a turn [rad]."""

    def __post_init__(self) -> None:
        for setting in fields(self):
            value = getattr(self, setting.name)
            if not math.isfinite(value) or ("std" in setting.name and value < 0):
                raise DpSlamError(f"dp_slam.motion.{setting.name} is out of range: {value}")
        for name in ("floor", "turn_floor"):
            if not getattr(self, name) > 0:
                raise DpSlamError(f"dp_slam.motion.{name} must be positive, found {getattr(self, name)}")
        check_magnitudes(self, DpSlamError)


ATRV_JR = MotionModel(
    d_per_metre=0.9577,
    d_per_radian=-0.0049,
    c_per_metre=-0.0107,
    c_per_radian=0.0002,
    t_per_metre=-0.0105,
    t_per_radian=0.9437,
)
"""Learnt by the authors for the robot of their loop5 log."""


@dataclass(frozen=True, kw_only=True)
class DpSlamConfig:
    """Settings of DP-SLAM."""

    particles: int = 50
    """Most particles kept; each has a map of its own."""
    samples: int = 500
    """Poses drawn from the motion model for each scan."""
    resolution: float = 0.03
    """Side of a cell [m]."""
    max_range: float = 7.95
    """Beams are used up to here [m]; longer ones and those without return pass through."""
    max_beams: int = 181
    """Lasers with more beams are thinned to about this many."""
    range_variance: float = 0.017
    """σ² of a reading [m²]: tilt, calibration and the grid besides the device's noise."""
    floor: float = 0.315
    """Least likelihood of a beam: something random happened."""
    prior_density: float = 0.125
    """Stops per metre in cells not seen yet [1/m]."""
    prior_length: float = 0.114
    """Path credited to a cell when it is first seen, without stops [m]."""
    trace_margin: float = 0.57
    """A beam is followed this far beyond its reading [m]."""
    quick_before: float = 0.1
    """The quick evaluation begins this far before the reading [m]."""
    quick_beyond: float = 0.086
    """The quick evaluation ends this far beyond the reading [m]."""
    passes: int = 9
    """Beams are evaluated in this many interleaved rounds; after each, samples are culled."""
    cull: float = 13.0
    """Samples are culled whose log-likelihood lies this far below the best."""
    motion: MotionModel = field(default_factory=MotionModel)
    """What is drawn from."""
    max_cells: int = 80_000_000
    """Larger grids are refused."""
    seed: int = 0
    """Of all that is random."""

    def __post_init__(self) -> None:
        for name in ("resolution", "max_range", "range_variance", "prior_density", "prior_length", "cull"):
            if not getattr(self, name) > 0:
                raise DpSlamError(f"dp_slam.{name} must be positive, found {getattr(self, name)}")
        for name in ("quick_before", "quick_beyond", "trace_margin"):
            if getattr(self, name) < 0:
                raise DpSlamError(f"dp_slam.{name} must not be negative, found {getattr(self, name)}")
        if not 1 <= self.particles <= self.samples:
            raise DpSlamError(f"dp_slam: need 1 <= particles <= samples, found {self.particles} and {self.samples}")
        for name in ("passes", "max_beams", "max_cells"):
            if not getattr(self, name) >= 1:
                raise DpSlamError(f"dp_slam.{name} must be at least 1, found {getattr(self, name)}")
        if not 0 < self.floor < 1:
            raise DpSlamError(f"dp_slam.floor must lie in (0, 1), found {self.floor}")
        if not 0 <= self.seed < 2**63:
            raise DpSlamError(f"dp_slam.seed must lie between 0 and 2⁶³, found {shown_number(self.seed)}")
        check_magnitudes(self, DpSlamError)
        check_between(
            self,
            DpSlamError,
            "dp_slam.",
            resolution=(1e-3, 100.0),
            max_range=(0.0, LIMITS.range),
            trace_margin=(0.0, 100.0),
            particles=(1, 100_000),
            samples=(1, 1_000_000),
            max_beams=(1, LIMITS.beams),
            passes=(1, LIMITS.beams),
        )
        check_limit(self.max_cells, "grid_cells", f"found dp_slam.max_cells {shown_number(self.max_cells)}")
