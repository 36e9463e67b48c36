"""Where the path from scan to scan may be broken, and what became of the suspicion."""

from dataclasses import dataclass
from typing import Literal

from iceg.slam.track import Track

Outcome = Literal["joined", "apart", "contradicted", "credible"]

REFUTED = 1.99
"""Strength of a doubt from which on odometry and match contradict each other beyond all chance."""
LOST = 3.0
"""Strength of a doubt from which on nothing was known when the robot went on …"""
ADRIFT = 4.0
"""… and not even odometry told the way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubt:
    """Why the path may be broken just before a key pose.

    Attributes:
        reason: what was noticed there, for a person.
        strength: compares doubts: the strongest is where a break is put.
    """

    reason: str
    strength: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Break:
    """Where the path from scan to scan does not hold.

    Attributes:
        key: the first key pose after it.
        outcome: "joined" by loop closures on both sides; "apart": nothing ties what follows to what was before, and
            odometry alone says where it is; "contradicted": closures disagree with the path, nothing else speaks
            against it, and the map follows the path; "credible": closures agree with where odometry led on, though not
            so many that chance is out of the question.
        reason: what was noticed there.
        closures: how many agree about it.
        moved: how far they say that the robot is from where the path puts it [m].
    """

    key: int
    outcome: Outcome
    reason: str
    closures: int = 0
    moved: float = 0.0


def describe_break(found: Break, track: Track) -> str:
    """A break in a sentence for a person."""
    where = f"before scan {track.keys[found.key].index} ({found.reason})"
    if found.outcome == "joined":
        return (
            f"the path is broken {where}: {found.closures} key scans that agree put the robot {found.moved:.1f} m from "
            "where the path does, and the map follows them"
        )
    if found.outcome == "apart":
        return f"the path is broken {where}: no loop closure ties the rest to what was before, it may be displaced"
    if found.outcome == "credible":
        return (
            f"the path may be broken {where}: odometry led on, and {found.closures} key scans agree with where it did, "
            "but not all; the map follows them"
        )
    return (
        f"the path may be broken {where}: {found.closures} key scans that agree put the robot {found.moved:.1f} m from "
        "where the path does; the robot was carried, or two places look alike; the map follows the path"
    )
