"""Settings of people who go along with the robot: what they look like, and what gives them away."""

from dataclasses import dataclass

from graph.ranges import RATES, between, positive
from iceg.slam.checked_settings import SlamSettings


@dataclass(frozen=True, kw_only=True)
class CompanionConfig(SlamSettings, prefix="companions: "):
    """When something stays beside the robot while everything else passes by. Asked only where there is odometry."""

    enabled: bool = True
    """Off leaves whoever goes along in the scans."""
    reach: float = between(3.5, 0.1, 100.0)
    """Whoever goes along is no farther from the laser [m]."""
    width: float = between(0.8, 0.01, 100.0)
    """An object that may be a person, or a leg, is no wider [m]."""
    min_returns: int = positive(2)
    """Fewest returns of such an object: one by itself is an outlier, and some lasers have many, everywhere."""
    gap: float = between(0.3, 0.01, 100.0)
    """What is seen beside such an object is farther away by more than this [m]."""
    step: float = between(0.7, 0.05, 100.0)
    """Scans are compared after so much path by odometry [m]: by then what stands has moved, seen from the robot."""
    min_step: float = between(0.8, 0.0, 1.0)
    """A step tells by which an object that stands has moved at least this share of that, seen from the robot."""
    stays: float = positive(0.5)
    """Whoever goes along moves no farther from one such scan to the next, seen from the robot [m]."""
    stands: float = positive(0.25)
    """Something stands that is seen no farther from where odometry foretells it [m]."""
    unexplained: float = between(0.8, 0.5, 1.0 - 1e-9)
    """Share of the steps at which somebody who goes along is seen where they were, and nothing where they would be if
    they stood."""
    hidden: float = between(0.1, *RATES)
    """Share of the steps at which that is so of something that stands: it is hidden, and another object is where it
    was."""
    false_alarm: float = between(1e-4, *RATES)
    """How probable it may be that something that stands is taken for somebody who goes along."""
    zone: float = positive(0.7)
    """Objects no farther from where somebody goes along belong to them [m]."""
