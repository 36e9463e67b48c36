"""The robot's description (URDF): where its fixed parts sit."""

import math
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from frontends.bags.rigid import Rigid

_ZEROS = (0.0, 0.0, 0.0)


def described_frames(descriptions: Sequence[str]) -> tuple[dict[tuple[str, str], Rigid], list[str]]:
    """The fixed joints of robot descriptions.

    Args:
        descriptions: XML texts.

    Returns:
        The pose of each child link in its parent, by the two names; and what a person should know.
    """
    found: dict[tuple[str, str], Rigid] = {}
    warnings = []
    for text in dict.fromkeys(descriptions):
        try:
            found |= _fixed_joints(_parsed(text))
        except (ET.ParseError, ValueError) as error:
            warnings.append(f"the robot's description cannot be read ({error}): it is left out")
    return found, warnings


def _parsed(text: str) -> ET.Element:
    if "<!ENTITY" in text:
        raise ValueError("it declares entities")
    return ET.fromstring(text)  # noqa: S314


def _fixed_joints(robot: ET.Element) -> dict[tuple[str, str], Rigid]:
    found = {}
    for joint in robot.iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if joint.get("type") != "fixed" or parent is None or child is None:
            continue
        origin = joint.find("origin")
        names = (parent.get("link", "").lstrip("/"), child.get("link", "").lstrip("/"))
        found[names] = (
            Rigid()
            if origin is None
            else Rigid.from_roll_pitch_yaw(_numbers(origin.get("xyz")), _numbers(origin.get("rpy")))
        )
    return found


def _numbers(text: str | None) -> tuple[float, ...]:
    if text is None:
        return _ZEROS
    numbers = tuple(map(float, text.split()))
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise ValueError(f"found '{text[:40]}', expected three numbers")
    return numbers
