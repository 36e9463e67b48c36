"""Settings of returns from the robot itself: which beams see it, and how near no wall can be."""

from dataclasses import dataclass
from math import pi

from graph.ranges import between, positive
from graph.units import Radians
from iceg.slam.checked_settings import SlamSettings


@dataclass(frozen=True, kw_only=True)
class OwnBodyConfig(SlamSettings, prefix="own_body: "):
    """When a return comes from the robot itself, or from the hands that carry it."""

    nearest: float = between(0.15, 0.0, 100.0)
    """Nearer returns come from the robot, or from hands around its laser [m]: no robot drives so close to a wall."""
    reach: float = between(1.5, 0.0, 100.0)
    """No part of the robot that its laser sees is farther away [m]; 0 looks for none."""
    scatter: float = positive(0.04)
    """What a beam returns from the robot differs by no more than twice this [m]."""
    agreement: float = between(0.8, 0.5, 1.0)
    """Least share of the returns no farther away that do so where a beam sees the robot: nothing comes before that."""
    seen: float = between(0.25, 0.0, 1.0)
    """Least share of the returns of a beam that come from the robot where it sees that: a thin post is missed often."""
    places: int = positive(12)
    """Fewest places with different surroundings that must tell."""
    change: float = positive(0.1)
    """The surroundings are different where half of the other beams return from a range that differs by more [m]."""
    fewest_others: int = between(10, 1, 1_000_000)
    """Fewest beams that tell whether the surroundings changed."""
    close_by: Radians = between(pi / 180.0, 0.0, pi)
    """Beams that pass this close to a part of the robot may hit it now and then [rad]."""
    beside: Radians = between(pi / 36.0, 0.0, pi)
    """What is beside a part of the robot is seen by the first beams that return, no farther off than this [rad]."""
    gap: float = between(0.2, 0.0, 100.0)
    """What is seen beside the robot is farther away by more than this [m] and a quarter of the range: where a wall goes
    on, the range does, too."""
    margin: float = positive(0.1)
    """Returns up to this far behind a part of the robot are taken for it [m], as are those as near from beams that pass
    close by."""
    hands: float = between(0.25, 0.0, 1.0)
    """Least share of the returns that come from hands where somebody holds the robot, and tilts it: what the laser sees
    then lies in no plane."""
    cloth: float = between(0.8, 0.0, 1.0)
    """From this share on it is no hands but something that covers the laser: the robot drives on."""
