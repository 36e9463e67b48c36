"""Settings of the sweep of the laser: how it is learned from scans of one place, and when beams are moved by it."""

from dataclasses import dataclass

from graph.ranges import RATES, between, positive
from graph.units import Radians
from iceg.slam.checked_settings import SlamSettings


@dataclass(frozen=True, kw_only=True)
class SweepConfig(SlamSettings, prefix="sweep: "):
    """How long a sweep of the laser takes and which way it goes, where the log does not say."""

    false_alarm: float = between(5.733e-7, *RATES)
    """A sweep is real that chance explains with a smaller probability (normal distribution; 5 σ)."""
    min_displacement: float = 0.005
    """Root mean square from which on what a sweep moves returns by is worth another pass [m]: half of what the ranges
    of a good laser err by. At half of it the classic logs of fast lasers are tracked twice and get no better, at twice
    of it some that gain a quarter are left as they are."""
    max_passes: int = between(2, 0, 100)
    """Most passes with beams moved by the sweep: what still moves after two are scans that match here or there; a third
    gained nothing."""
    max_share: float = positive(1.1)
    """A sweep takes no longer than so many intervals from scan to scan: the next one follows."""
    model_error: float = 0.015
    """Share of the sweep by which a parabola through poses misses the way of a robot at its fastest turn. By
    simulation."""
    pair_distance: float = positive(0.4, 0.01, 1000.0)
    """How far the scans before and after lie away that each scan asked is laid over, about [m]."""
    pair_turn: Radians = positive(0.35)
    """How far they may be turned instead [rad]; both add up."""
    bend_per_metre: float = 0.3
    """A metre of motion bends a scan as much as a turn of so much, at a usual range [rad/m]."""
    gate: float = positive(0.3)
    """Points farther off lie on other surfaces [m]."""
    scale: float = between(0.05, 1e-4, 100.0)
    """Width of the Cauchy weight of a point [m]."""
    min_points: int = positive(12)
    """Fewest points that two scans share."""
    min_pairs: int = positive(10)
    """Fewest pairs of scans that tell."""
    quick_scans: int = positive(100, 1, 100_000)
    """Scans that a quick look asks, those that move most in as many parts of the log."""
    quick_points: int = positive(90)
    """Points of each that take part in it, about."""
    quick_false_alarm: float = between(2.7e-3, *RATES)
    """A quick look settles the matter where chance explains the sweep with a larger probability, or where it is below
    what matters with all but this one (normal distribution; 3 σ)."""
    scans: int = positive(150, 1, 100_000)
    """Scans that a thorough look asks."""
    points: int = positive(180)
    """Points of each that take part in it, about."""
