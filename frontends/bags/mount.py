"""Where the laser sits on the robot: from transforms, or the robot's description."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.bags.frames import Frames
from frontends.bags.sources import last_word

_TILTED = math.cos(math.radians(5.0))
_BASES = ("base_footprint", "base_link", "base")


@dataclass(frozen=True, kw_only=True)
class Mount:
    """Where the laser sits.

    Attributes:
        T_robot_laser: (3,) x, y [m], heading [rad].
        is_upside_down: whether its bearings run clockwise on the robot.
        is_known: whether the bag says it.
        reason: where this is known from, for a person.
        warnings: what is odd about it.
    """

    T_robot_laser: NDArray[np.float64]
    is_upside_down: bool = False
    is_known: bool = True
    reason: str
    warnings: tuple[str, ...] = ()


def base_of(frame: str, frames: Frames) -> str:
    """The frame of the robot that a laser sits on: called base, else the lowest that nothing carries."""
    chain = frames.above(frame)
    for base in _BASES:
        found = next((name for name in chain if last_word(name) == base), None)
        if found is not None:
            return found
    own = [name for name in chain if last_word(name) not in {"odom", "map", "world"}]
    return own[-1] if own else frame


def find_mount(base: str, frame: str, frames: Frames) -> Mount:
    """The pose of a laser's frame on the robot's.

    Args:
        base: the robot's frame.
        frame: the laser's.
        frames: what the bag says of frames.
    """
    if base == frame:
        if last_word(frame) in _BASES:
            return Mount(T_robot_laser=np.zeros(3), reason=f"the scans are given in the robot's frame '{frame}'")
        return Mount(
            T_robot_laser=np.zeros(3),
            is_known=False,
            reason=f"not stated: the trajectory is that of the laser's frame '{frame}'",
        )
    found = frames.between(base, frame)
    if found is None:
        return Mount(
            T_robot_laser=np.zeros(3), is_known=False, reason=f"not stated: '{frame}' at the centre of '{base}'"
        )
    pose, moving = found
    warnings = []
    if moving:
        warnings.append(f"the laser moves on the robot ({', '.join(moving)}): its place halfway is taken for all scans")
    if abs(pose.upright) < _TILTED:
        tilt = math.degrees(math.acos(min(1.0, abs(pose.upright))))
        warnings.append(f"the laser is tilted by {tilt:.0f}°: what it sees is taken to lie in the plane")
    upside_down = pose.upright < 0.0
    if upside_down:
        warnings.append("the laser is mounted upside down: its beams are put in the usual order")
    x, y, heading = pose.planar.tolist()
    return Mount(
        T_robot_laser=np.array([round(x, 6), round(y, 6), round(heading, 8)]) + 0.0,
        is_upside_down=upside_down,
        reason=f"the pose of '{frame}' in '{base}' by the bag's transforms or robot description",
        warnings=tuple(warnings),
    )
