"""Settings of the sweep of the laser: how it is learned from scans of one place, and when beams are moved by it."""

from dataclasses import dataclass

from graph.ranges import RATES, check_between, check_numbers
from graph.units import Radians
from iceg.slam.config_error import SlamConfigError


@dataclass(frozen=True, kw_only=True)
class SweepConfig:
    """How long a sweep of the laser takes and which way it goes, where the log does not say."""

    false_alarm: float = 5.733e-7
    """A sweep is real that chance explains with a smaller probability (normal distribution; 5 σ)."""
    min_displacement: float = 0.005
    """Root mean square from which on what a sweep moves returns by is worth another pass [m]: half of what the ranges
    of a good laser err by. At half of it the classic logs of fast lasers are tracked twice and get no better, at twice
    of it some that gain a quarter are left as they are."""
    max_passes: int = 2
    """Most passes with beams moved by the sweep: what still moves after two are scans that match here or there; a third
    gained nothing."""
    max_share: float = 1.1
    """A sweep takes no longer than so many intervals from scan to scan: the next one follows."""
    model_error: float = 0.015
    """Share of the sweep by which a parabola through poses misses the way of a robot at its fastest turn. By
    simulation."""
    pair_distance: float = 0.4
    """How far the scans before and after lie away that each scan asked is laid over, about [m]."""
    pair_turn: Radians = 0.35
    """How far they may be turned instead [rad]; both add up."""
    bend_per_metre: float = 0.3
    """A metre of motion bends a scan as much as a turn of so much, at a usual range [rad/m]."""
    gate: float = 0.3
    """Points farther off lie on other surfaces [m]."""
    scale: float = 0.05
    """Width of the Cauchy weight of a point [m]."""
    min_points: int = 12
    """Fewest points that two scans share."""
    min_pairs: int = 10
    """Fewest pairs of scans that tell."""
    quick_scans: int = 100
    """Scans that a quick look asks, those that move most in as many parts of the log."""
    quick_points: int = 90
    """Points of each that take part in it, about."""
    quick_false_alarm: float = 2.7e-3
    """A quick look settles the matter where chance explains the sweep with a larger probability, or where it is below
    what matters with all but this one (normal distribution; 3 σ)."""
    scans: int = 150
    """Scans that a thorough look asks."""
    points: int = 180
    """Points of each that take part in it, about."""

    def __post_init__(self) -> None:
        counts = ("min_points", "min_pairs", "quick_scans", "quick_points", "scans", "points")
        lengths = ("pair_distance", "pair_turn", "gate", "max_share")
        check_numbers(self, SlamConfigError, positive=(*counts, *lengths))
        check_between(self, SlamConfigError, "sweep: ", false_alarm=RATES, quick_false_alarm=RATES, scale=(1e-4, 100.0))
        check_between(self, SlamConfigError, "sweep: ", max_passes=(0, 100), pair_distance=(0.01, 1000.0))
        check_between(self, SlamConfigError, "sweep: ", quick_scans=(1, 100_000), scans=(1, 100_000))
