"""Rigid transforms in space, as bags state them, and what of them counts in the plane."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.elementary import arctan2
from graph.se2 import wrap_angle

_NO_ROTATION = 1e-6
"""A quaternion shorter than this says nothing: some drivers write zeros."""


class Rigid(NamedTuple):
    """The pose of one frame in another.

    Attributes:
        x: [m].
        y: [m].
        z: [m].
        qx: of the unit quaternion.
        qy: …
        qz: …
        qw: …
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0
    qw: float = 1.0

    @classmethod
    def of(cls, numbers: tuple[float, ...]) -> "Rigid":
        """From x, y, z and a quaternion of any length."""
        x, y, z, qx, qy, qz, qw = numbers
        length = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
        if not length > _NO_ROTATION:
            return cls(x, y, z)
        return cls(x, y, z, qx / length, qy / length, qz / length, qw / length)

    @classmethod
    def from_roll_pitch_yaw(cls, xyz: tuple[float, ...], rpy: tuple[float, ...]) -> "Rigid":
        """As URDF states them: turned about the fixed x, y and z axes in turn [rad]."""
        (sr, cr), (sp, cp), (sy, cy) = ((math.sin(0.5 * angle), math.cos(0.5 * angle)) for angle in rpy)
        x, y, z = xyz
        return cls(
            x,
            y,
            z,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )

    def compose(self, other: "Rigid") -> "Rigid":
        """The pose of c in a, of b in a (this) and of c in b."""
        x, y, z = self.turned(other.x, other.y, other.z)
        ax, ay, az, aw, bx, by, bz, bw = *self[3:], *other[3:]
        return Rigid(
            self.x + x,
            self.y + y,
            self.z + z,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )

    def inverse(self) -> "Rigid":
        """The pose of a in b."""
        back = Rigid(0.0, 0.0, 0.0, -self.qx, -self.qy, -self.qz, self.qw)
        x, y, z = back.turned(self.x, self.y, self.z)
        return Rigid(-x, -y, -z, *back[3:])

    def turned(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """A vector of b with the axes of a."""
        qx, qy, qz, qw = self[3:]
        cx, cy, cz = 2.0 * (qy * z - qz * y), 2.0 * (qz * x - qx * z), 2.0 * (qx * y - qy * x)
        return (
            x + qw * cx + qy * cz - qz * cy,
            y + qw * cy + qz * cx - qx * cz,
            z + qw * cz + qx * cy - qy * cx,
        )

    @property
    def upright(self) -> float:
        """Cosine of the angle between the two vertical axes: -1 for what hangs upside down."""
        return 1.0 - 2.0 * (self.qx * self.qx + self.qy * self.qy)

    @property
    def planar(self) -> NDArray[np.float64]:
        """(3,) x, y [m] and the heading of the x axis [rad]."""
        ahead_x, ahead_y, _ = self.turned(1.0, 0.0, 0.0)
        return np.array([self.x, self.y, wrap_angle(math.atan2(ahead_y, ahead_x))]) + 0.0


def planar_poses(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses in space as poses in the plane.

    Args:
        rows: (n, 7) x, y, z and quaternion x, y, z, w.

    Returns:
        (n, 3) x, y [m] and the heading of the x axis [rad].
    """
    qx, qy, qz, qw = rows[:, 3:].T
    heading = arctan2(2.0 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz)
    return np.column_stack([rows[:, 0], rows[:, 1], wrap_angle(heading)]) + 0.0
