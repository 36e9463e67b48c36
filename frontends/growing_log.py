"""A log that grows scan by scan, each checked as it comes."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from frontends.arrays import checked_finite, checked_pose, checked_readings
from frontends.logs.laser_mount import UNKNOWN
from frontends.logs.plausibility import judge_odometry
from frontends.logs.usable_range import UsableRange, mask_no_returns
from frontends.scan import Log, ScanError, ScanGeometry
from graph.growing_rows import GrowingRows


class GrowingLog:
    """Scans of one laser in the order of time, all with odometry or all without, and so with stamps."""

    def __init__(self, geometry: ScanGeometry, path: Path, *, is_mount_known: bool = True) -> None:
        """Start with no scan of a laser, whose place is known or not; the log will be called `path`."""
        self.geometry = geometry
        self._is_mount_known = is_mount_known
        self._path = path
        self._usable = UsableRange(range_min=geometry.range_min, range_max=geometry.range_max)
        self._ranges: GrowingRows[np.float32] = GrowingRows((geometry.n_beams,), np.float32)
        self._odometry: GrowingRows[np.float64] = GrowingRows((3,), np.float64)
        self._stamps: GrowingRows[np.float64] = GrowingRows((), np.float64)
        self._has_stamps = False
        self.has_odometry = False
        """Whether scans come with odometry; False before the first."""

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def ranges(self) -> NDArray[np.float32]:
        """(n_scans, n_beams) [m], NaN without return; a view."""
        return self._ranges.rows

    @property
    def odometry(self) -> NDArray[np.float64]:
        """(n_scans, 3) T_odom_robot as it came, zero where there is none; a view."""
        return self._odometry.rows

    @property
    def stamps(self) -> NDArray[np.float64]:
        """(n_scans,) [s]; scans are numbered where none come; a view."""
        return self._stamps.rows

    def append(self, ranges: ArrayLike, odometry: ArrayLike | None, stamp: float | None) -> None:
        """Add one scan; one that is refused leaves the log as it was.

        Args:
            ranges: (n_beams,) readings [m]; those outside the geometry's limits, NaN and infinite ones are no returns.
            odometry: (3,) x [m], y [m], heading [rad]; None in a log without.
            stamp: [s], may step back; None in a log without.

        Raises:
            ScanError: an array is not of the shape it must have, or holds what it must not; or odometry or stamp come
                with some scans only.
        """
        index = len(self)
        readings = checked_readings(ranges, self.geometry.n_beams)
        mask_no_returns(readings, self._usable)
        self._check_same("odometry", index, self.has_odometry, odometry)
        self._check_same("stamps", index, self._has_stamps, stamp)
        pose = np.zeros(3) if odometry is None else checked_pose("odometry", odometry)
        time = float(index) if stamp is None else float(checked_finite("stamps", stamp, ()))
        Log(
            ranges=readings[None],
            odometry=pose[None],
            stamps=np.array([time]),
            geometry=self.geometry,
            path=Path(f"{self._path}: scan {index}"),
        )  # refuses what is beyond the limits
        self.has_odometry, self._has_stamps = odometry is not None, stamp is not None
        self._ranges.append(readings)
        self._odometry.append(pose)
        self._stamps.append(time)

    @staticmethod
    def _check_same(name: str, index: int, came: bool, value: object) -> None:
        if index and came != (value is not None):
            found, expected = ("none", "some") if came else ("some", "none")
            raise ScanError(f"found {found} {name} at scan {index}, expected {expected} as with the scans before")

    def log(self) -> Log:
        """The scans so far, as a log that does not change any more.

        Raises:
            ScanError: there are none.
        """
        if not len(self):
            raise ScanError(f"{self._path}: found no scan, expected at least one")
        ranges, odometry = self.ranges.copy(), self.odometry.copy()
        has_odometry, warnings = False, ["there is no odometry"]
        if self.has_odometry:
            has_odometry, warnings = judge_odometry(odometry, ranges, self.stamps if self._has_stamps else None)
        if has_odometry and not self._is_mount_known:
            warnings = [*warnings, UNKNOWN]
        if not self._has_stamps:
            warnings = [*warnings, "there are no stamps: scans are numbered 0, 1, 2 … s instead"]
        return Log(
            ranges=ranges,
            odometry=odometry,
            stamps=self.stamps.copy(),
            geometry=self.geometry,
            path=self._path,
            has_odometry=has_odometry,
            is_mount_known=self._is_mount_known,
            warnings=tuple(warnings),
            message_counts={"scans": len(self)},
        )
