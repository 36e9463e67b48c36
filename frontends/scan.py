"""Scans and logs as arrays: what every reader returns and every matcher takes."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graph.counted import counted
from graph.elementary import cos_sin
from graph.errors import IcegError
from graph.limits import LIMITS


class ScanError(IcegError):
    """Numbers that are no scan, no laser or no log."""


WHOLE_TURN = 2.0 * np.pi + 2e-3
"""The widest field of view [rad]; the first beam may be measured twice, and steps are printed rounded."""
_MOST_BEARING = 8.0 * np.pi
"""Farther round no beam points, however the angles are counted [rad]."""


@dataclass(frozen=True, kw_only=True)
class ScanGeometry:
    """How one laser sees: its beams, its usable range and where it sits on the robot.

    Attributes:
        bearings: (n_beams,) beam directions in the laser frame [rad], counter-clockwise positive, increasing.
        range_min: shortest range taken as a return [m].
        range_max: longest range taken as a return [m].
        T_robot_laser: (3,) pose of the laser on the robot: x [m], y [m], heading [rad].

    Raises:
        ScanError: fewer than two bearings, some that do not increase or span more than a whole turn, a range or a place
            that no laser has.
    """

    bearings: NDArray[np.float64]
    range_min: float
    range_max: float
    T_robot_laser: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    def __repr__(self) -> str:
        first, last = np.degrees([self.bearings[0], self.bearings[-1]]).tolist()
        x, y, heading = self.T_robot_laser
        return (
            f"ScanGeometry({self.n_beams} beams from {first:.4g}° to {last:.4g}°, {self.range_min:g} to "
            f"{self.range_max:.4g} m, at {x:.3g}, {y:.3g} m, {np.degrees(heading):.3g}°)"
        )

    def __post_init__(self) -> None:
        bearings, place = np.asarray(self.bearings), np.asarray(self.T_robot_laser)
        if bearings.ndim != 1 or not 2 <= len(bearings) <= LIMITS.beams:
            raise ScanError(f"found bearings of shape {bearings.shape}, expected one row of 2 to {LIMITS.beams}")
        if not (np.abs(bearings).max() <= _MOST_BEARING and bearings[-1] - bearings[0] <= WHOLE_TURN):
            raise ScanError(
                f"found bearings from {bearings.min():g} to {bearings.max():g} rad, expected them within a whole turn"
            )
        if not (bearings[1:] > bearings[:-1]).all():
            raise ScanError("found bearings that do not increase from each beam to the next, expected them to")
        if not 0 <= self.range_min <= self.range_max:
            raise ScanError(f"found ranges from {self.range_min} to {self.range_max} m, expected 0 ≤ least ≤ most")
        if place.shape != (3,) or not (np.abs(place) <= (LIMITS.range, LIMITS.range, LIMITS.heading)).all():
            raise ScanError(f"found the laser at {place.tolist()} on the robot, expected x, y [m] and heading [rad]")

    @property
    def n_beams(self) -> int:
        """Number of beams of one scan."""
        return len(self.bearings)

    @cached_property
    def field_of_view(self) -> float:
        """Angle between the first and the last beam [rad]."""
        return float(self.bearings[-1] - self.bearings[0])

    @cached_property
    def resolution(self) -> float:
        """Angle between two neighbouring beams [rad]."""
        return self.field_of_view / (self.n_beams - 1)

    @property
    def is_full_circle(self) -> bool:
        """Whether the first beam follows the last one."""
        return self.field_of_view > WHOLE_TURN - 1.5 * self.resolution

    @cached_property
    def directions_robot(self) -> NDArray[np.float64]:
        """(n_beams, 2) unit vectors of the beams in the robot frame."""
        angles = self.bearings + self.T_robot_laser[2]
        return np.stack(cos_sin(angles), axis=1)

    @cached_property
    def origin_robot(self) -> NDArray[np.float64]:
        """(2,) position of the laser in the robot frame [m]."""
        return np.array(self.T_robot_laser[:2], dtype=np.float64)


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan:
    """One sweep of the laser, compared by identity so that a matcher can remember what it extracted from it.

    Attributes:
        ranges: (n_beams,) float32 [m]; NaN where the beam had no usable return.
        geometry: the laser that took it.
    """

    ranges: NDArray[np.float32]
    geometry: ScanGeometry

    def __repr__(self) -> str:
        returned = int(np.isfinite(self.ranges).sum())
        return f"Scan({returned} of {counted(len(self.ranges), 'beam')} returned)"

    @classmethod
    def from_ranges(
        cls,
        ranges: ArrayLike,
        *,
        field_of_view: float,
        range_min: float = 0.02,
        range_max: float = np.inf,
        T_robot_laser: ArrayLike = (0.0, 0.0, 0.0),
    ) -> "Scan":
        """A scan from plain numbers, beams evenly spread from right to left around straight ahead.

        Args:
            ranges: (n_beams,) readings [m], at least two; zero, negative, NaN and infinite ones are no returns.
            field_of_view: angle between the first and the last beam [rad].
            range_min: shorter readings are no returns [m].
            range_max: readings of this length and more are no returns [m].
            T_robot_laser: (3,) pose of the laser on the robot.

        Raises:
            ScanError: the ranges are not one row of at least two, or the field of view is not positive and at most
                a whole turn.
        """
        readings = np.ma.filled(np.ma.asarray(ranges, dtype=np.float32), np.nan)
        if readings.ndim != 1 or len(readings) < 2:
            raise ScanError(f"found ranges of shape {readings.shape}, expected one row of at least 2")
        if not 0 < field_of_view <= WHOLE_TURN:
            raise ScanError(f"found a field of view of {field_of_view} rad, expected more than 0 and at most 2π")
        usable = np.isfinite(readings) & (readings >= range_min) & (readings < range_max)
        half = 0.5 * field_of_view
        geometry = ScanGeometry(
            bearings=np.linspace(-half, half, len(readings)),
            range_min=range_min,
            range_max=range_max,
            T_robot_laser=np.array(T_robot_laser, dtype=np.float64),
        )
        return cls(ranges=np.where(usable, readings, np.float32(np.nan)), geometry=geometry)

    @property
    def points(self) -> NDArray[np.float64]:
        """(n_returns, 2) end points in the robot frame [m], in beam order; beams without return are left out."""
        hit = np.isfinite(self.ranges)
        return self.geometry.origin_robot + self.ranges[hit, None] * self.geometry.directions_robot[hit]


@dataclass(frozen=True, kw_only=True)
class Log:
    """A recorded log, in file order (which is time order, whatever the stamps say).

    Attributes:
        ranges: (n_scans, n_beams) float32 [m]; NaN where a beam had no usable return.
        odometry: (n_scans, 3) raw odometry of the robot at each scan, T_odom_robot.
        stamps: (n_scans,) seconds as recorded; may jitter and step back.
        geometry: the laser.
        path: where it was read from.
        has_odometry: False when the recorded odometry is missing or says nothing (constant while the scans change).
        warnings: what the reader noticed, in sentences for a person.
        skipped_lines: malformed lines passed over on request.
        message_counts: how many messages of each kind the file holds, used or not.
        truth: (n_scans, 3) true pose of the robot at each scan, in a frame of its own, where the log holds it (a
            simulator's does); None elsewhere.
        sweep: seconds by which the beam of the largest bearing is measured after the one of the smallest; negative
            where the laser turns clockwise, 0 where all beams are measured at once, None where the log does not say.
            Odometry, stamp and truth of a scan are those of the middle of its sweep.
        choices: what a reader chose where the file left a choice, and why: a sentence by its subject, such as "laser".
        gyro: (n_scans, 3) angular velocity about three axes fixed to the robot, integrated from the first scan to each;
            None where the log has none. Axes, signs, unit and bias are as recorded: a run learns them.
        is_mount_known: whether the log says where the laser sits; where it does not, a run learns it from the odometry.

    Raises:
        ScanError: arrays that do not belong together, or numbers that are not finite or beyond `graph.limits`.
    """

    ranges: NDArray[np.float32]
    odometry: NDArray[np.float64]
    stamps: NDArray[np.float64]
    geometry: ScanGeometry
    path: Path
    has_odometry: bool = True
    warnings: tuple[str, ...] = ()
    skipped_lines: int = 0
    message_counts: Mapping[str, int] = field(default_factory=dict)
    truth: NDArray[np.float64] | None = None
    sweep: float | None = None
    choices: Mapping[str, str] = field(default_factory=dict)
    gyro: NDArray[np.float64] | None = None
    is_mount_known: bool = True

    @classmethod
    def from_arrays(
        cls,
        ranges: ArrayLike,
        *,
        bearings: ArrayLike | None = None,
        field_of_view: float | None = None,
        odometry: ArrayLike | None = None,
        stamps: ArrayLike | None = None,
        truth: ArrayLike | None = None,
        range_min: float | None = None,
        range_max: float | None = None,
        T_robot_laser: ArrayLike | None = None,
        sweep: float | None = None,
        gyro: ArrayLike | None = None,
        name: str = "arrays",
    ) -> "Log":
        """A log from plain arrays, whatever they come from.

        Args:
            ranges: (n_scans, n_beams) readings [m], in the order of time; zero, negative, NaN and infinite ones are no
                returns.
            bearings: (n_beams,) direction of each beam in the laser's frame [rad], counter-clockwise positive, evenly
                spread, increasing or decreasing; or else
            field_of_view: angle between the first beam, at the right, and the last [rad], around straight ahead.
            odometry: (n_scans, 3) x [m], y [m], heading [rad] of the robot by its wheels; None for none.
            stamps: (n_scans,) [s]; None for none.
            truth: (n_scans, 3) true poses of the robot, in a frame of their own.
            range_min: shorter readings are no returns [m]; None for 2 cm.
            range_max: readings of this length and more are no returns [m]; None to tell it from the readings.
            T_robot_laser: (3,) where the laser sits on the robot: x [m], y [m], heading [rad]; None where that is not
                known: at its centre, unless the odometry tells a run otherwise.
            sweep: seconds by which the beam of the largest bearing is measured after the one of the smallest, see
                `sweep` above; stamps and poses are those of the middle.
            gyro: (n_scans,) or (n_scans, 3) turn rate about the vertical axis or about three axes, integrated up to
                each scan, in any unit and with any bias, see `gyro` above; None for none.
            name: what the log is called.

        Raises:
            ScanError: an array is not of the shape it must have, or holds what it must not.
        """
        from frontends.arrays import log_from_arrays

        return log_from_arrays(
            ranges,
            bearings=bearings,
            field_of_view=field_of_view,
            odometry=odometry,
            stamps=stamps,
            truth=truth,
            range_min=range_min,
            range_max=range_max,
            T_robot_laser=T_robot_laser,
            sweep=sweep,
            gyro=gyro,
            path=Path(name),
        )

    def __post_init__(self) -> None:
        n = len(self.ranges)
        if self.ranges.shape != (n, self.geometry.n_beams):
            raise ScanError(
                f"{self.path}: found ranges of shape {self.ranges.shape}, expected a row a scan and "
                f"{self.geometry.n_beams} columns, one a beam"
            )
        if self.ranges.size and not np.fmax.reduce(self.ranges, axis=None, initial=0.0) <= LIMITS.range:
            raise ScanError(f"{self.path}: found ranges of more than {LIMITS.range:g} m, expected NaN for no return")
        _check_poses(self.odometry, n, f"{self.path}: odometry")
        if self.truth is not None:
            _check_poses(self.truth, n, f"{self.path}: truth")
        if self.stamps.shape != (n,) or not (np.abs(self.stamps) <= LIMITS.stamp).all():
            raise ScanError(f"{self.path}: expected {n} finite stamps of at most {LIMITS.stamp:g} s")
        if self.gyro is not None and (self.gyro.shape != (n, 3) or not (np.abs(self.gyro) <= LIMITS.gyro).all()):
            raise ScanError(
                f"{self.path}: found integrated turn rates of shape {self.gyro.shape}, up to "
                f"{np.abs(self.gyro).max(initial=0.0):g}, expected {(n, 3)} finite numbers of at most {LIMITS.gyro:g}"
            )

    def __repr__(self) -> str:
        odometry = "" if self.has_odometry else ", no odometry"
        return f"Log({self.path.name}: {counted(len(self), 'scan')} of {self.geometry.n_beams} beams{odometry})"

    def __len__(self) -> int:
        """Number of scans."""
        return len(self.ranges)

    def scan(self, index: int) -> Scan:
        """The scan at `index`, counted from 0 in file order."""
        return Scan(ranges=self.ranges[index], geometry=self.geometry)

    def select(self, scans: slice | NDArray[np.int64]) -> "Log":
        """The log of some of the scans, in the order of their indices (m,), which may repeat; of a slice no copies."""
        return replace(
            self,
            ranges=self.ranges[scans],
            odometry=self.odometry[scans],
            stamps=self.stamps[scans],
            truth=None if self.truth is None else self.truth[scans],
            gyro=None if self.gyro is None else self.gyro[scans],
        )


def _check_poses(poses: NDArray[np.float64], n: int, where: str) -> None:
    """Refuse what is not (n, 3) poses within the limits."""
    if poses.shape != (n, 3):
        raise ScanError(f"{where}: found shape {poses.shape}, expected {(n, 3)}: x, y, heading of each scan")
    most = (LIMITS.coordinate, LIMITS.coordinate, LIMITS.heading)
    bad = np.flatnonzero(~(np.abs(poses) <= most).all(axis=1))
    if len(bad):
        raise ScanError(
            f"{where}: found {poses[bad[0]].tolist()} at scan {bad[0]}, expected finite numbers within {most[0]:g} m"
        )
