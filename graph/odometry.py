"""How far odometry can be off after a path: noise that grows with every metre driven and every radian turned."""

import math
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graph.errors import GraphError, IcegError
from graph.ranges import check_between, check_magnitudes
from graph.se2 import compose_covariance, inverse
from graph.short_repr import short_repr
from graph.units import Radians


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryMotion:
    """What odometry says since a key pose.

    Attributes:
        T_key_robot: (3,) pose of the robot in the frame of the key pose.
        covariance: (3, 3) in the tangent space at it, right perturbation, order x, y, θ.
        distance: path length [m]; forth and back both count.
        turn: sum of |heading change| along the path [rad].
    """

    T_key_robot: NDArray[np.float64]
    covariance: NDArray[np.float64]
    distance: float = 0.0
    turn: float = 0.0

    __repr__ = short_repr


@dataclass(frozen=True, kw_only=True)
class OdometryModel:
    """Noise of wheel odometry, independent from one bit of path to the next.

    Variances are proportional to the path length and to the angle turned through, so a straight line or a turn on the
    spot has one covariance however finely it is recorded, and turning left and right again is not free. The floors
    enter once per motion, at its start: what a key pose itself is off by, because odometry and laser do not share a
    clock.

    The defaults suit small indoor robots: over steps of about 1 m the normalised squared error against reference poses,
    3 when right, averages 2.6 (Intel), 4.4 (MIT CSAIL), 2.2 (ACES) and 2.0 (MRPT's simulation).

    Attributes:
        along_per_metre: standard deviation along the direction of travel after 1 m [m/√m].
        across_per_metre: standard deviation across it after 1 m [m/√m].
        position_per_radian: standard deviation of the position, any direction, after turning by 1 rad [m/√rad].
        heading_per_metre: standard deviation of the heading after 1 m [rad/√m].
        heading_per_radian: standard deviation of the heading after turning by 1 rad [rad/√rad].
        along_floor: standard deviation of the position straight ahead without any motion [m]; above 0.
        across_floor: standard deviation of the position to the side without any motion [m]; smaller than ahead
            where it stems from clocks, for the robot drives ahead.
        heading_floor: standard deviation of the heading without any motion [rad]; above 0.
    """

    along_per_metre: float = 0.05
    across_per_metre: float = 0.04
    position_per_radian: float = 0.05
    heading_per_metre: float = 0.04
    heading_per_radian: float = 0.10
    along_floor: float = 0.01
    across_floor: float = 0.01
    heading_floor: Radians = 0.01

    def __post_init__(self) -> None:
        for setting in fields(self):
            value = getattr(self, setting.name)
            least = "above 0" if setting.name.endswith("_floor") else "0 or above"
            if not (math.isfinite(value) and value >= 0.0) or (value == 0.0 and least == "above 0"):
                raise GraphError(f"odometry: {setting.name} is a standard deviation {least}, found {value}")
        check_magnitudes(self, GraphError)

    def start(self) -> OdometryMotion:
        """No motion yet: the robot stands at the key pose."""
        return OdometryMotion(T_key_robot=np.zeros(3), covariance=self._floor.copy())

    def extend(self, motion: OdometryMotion, increments: NDArray[np.float64]) -> OdometryMotion:
        """The motion with more increments; for the loop over scans.

        Args:
            motion: since the key pose.
            increments: (3,) from the last odometry pose to the next, or (n, 3) of them.

        Returns:
            The motion up to the last odometry pose.
        """
        # Imported here, because settings hold this class and must be there at once.
        from graph import _odometry_kernels as kernels

        pose, covariance = motion.T_key_robot.copy(), motion.covariance.copy()
        distance, turn = kernels.carry(pose, covariance, increments.reshape(-1, 3), self.variances)
        return OdometryMotion(
            T_key_robot=pose,
            covariance=covariance,
            distance=motion.distance + distance,
            turn=motion.turn + turn,
        )

    def covariance(self, increments: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance of the motion that increments make up; many motions at once over the leading axes.

        Args:
            increments: (..., n, 3) each pose in the frame of the one before it; n may be 0.

        Returns:
            (..., 3, 3) in the tangent space at the motion's end: what `extend` arrives at step by step.
        """
        steps = np.asarray(increments, dtype=np.float64)
        own = self._increment_covariances(steps)
        total = np.broadcast_to(self._floor, (*steps.shape[:-2], 3, 3))
        for k in range(steps.shape[-2]):
            total = compose_covariance(total, steps[..., k, :], own[..., k, :, :])
        return np.array(total)

    @cached_property
    def _floor(self) -> NDArray[np.float64]:
        return np.diag((self.along_floor**2, self.across_floor**2, self.heading_floor**2))

    @cached_property
    def variances(self) -> NDArray[np.float64]:
        """(5,) along and across per metre, position per radian, heading per metre and per radian."""
        return np.array(
            (
                self.along_per_metre**2,
                self.across_per_metre**2,
                self.position_per_radian**2,
                self.heading_per_metre**2,
                self.heading_per_radian**2,
            )
        )

    def _increment_covariances(self, T_prev_cur: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 3, 3) of (..., 3) increments: along the direction of travel one variance, across it another."""
        travel_cur = -inverse(T_prev_cur)[..., :2]
        distance, turn = np.hypot(travel_cur[..., 0], travel_cur[..., 1]), np.abs(T_prev_cur[..., 2])
        stretch = (self.along_per_metre**2 - self.across_per_metre**2) / np.where(distance > 0.0, distance, 1.0)
        any_direction = self.across_per_metre**2 * distance + self.position_per_radian**2 * turn
        total = np.zeros((*T_prev_cur.shape[:-1], 3, 3))
        total[..., :2, :2] = stretch[..., None, None] * travel_cur[..., :, None] * travel_cur[
            ..., None, :
        ] + any_direction[..., None, None] * np.eye(2)
        total[..., 2, 2] = self.heading_per_metre**2 * distance + self.heading_per_radian**2 * turn
        return total


def check_odometry_setting(model: OdometryModel, error: type[IcegError], name: str) -> None:
    """Refuse noise, given as a setting, so unlike from axis to axis that no covariance in double precision holds it.

    Args:
        model: the noise.
        error: raised where a number is out of range.
        name: of the setting, for the message.

    Raises:
        IcegError: of the type given, with the field, what was found and what was expected.
    """
    bounds = {field.name: (1e-5 if field.name.endswith("_floor") else 0.0, 100.0) for field in fields(model)}
    check_between(model, error, f"{name}.", **bounds)
