"""The front end over a log that still grows: what it learns of the odometry, it learns from what there is."""

import math
from bisect import bisect_right
from collections.abc import Callable

import numpy as np

from frontends.growing_log import GrowingLog
from frontends.scan import Scan
from graph.arrays import Bools, Floats
from graph.growing_rows import GrowingRows
from graph.odometry import OdometryMotion
from graph.se2 import between
from iceg.config import Config
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.odometry.calibration import OdometryCalibration, calibrate_odometry
from iceg.slam.recording.intervals import waits
from iceg.slam.recording.own_body import beyond
from iceg.slam.recording.steps import late_steps, sudden_steps, usual_reach
from iceg.slam.track import Track
from iceg.slam.tracking.front_end import FrontEnd

_RECENT = 256
"""Scans whose steps tell whether the newest one stands out, and around which late odometry is interpolated."""
_SELDOM = 32
"""Scans from which on it is not asked after each how far steps usually are: that takes as long as to track one."""


class IncrementalTracking:
    """Tracks a robot scan by scan, as `iceg.slam.tracking.log_tracking` does with a whole log.

    After the first part, as long as the settings say, the odometry is calibrated; what was tracked before stays.
    """

    def __init__(self, log: GrowingLog, matcher: MapMatcher, config: Config, own_body: Floats) -> None:
        """Start at the first scan of the log.

        Args:
            log: grows; holds the first scan.
            matcher: ICE or any other.
            config: widened for the noise of the laser.
            own_body: (n_beams,) nearer returns come from the robot itself [m].
        """
        self._log = log
        self._own_body = own_body
        self._config = config
        self.calibration = OdometryCalibration(noise=config.odometry, lasting_noise=config.odometry)
        self._is_first_part = log.has_odometry and config.front_end.calibrate_odometry
        self._path = self._turn = 0.0
        self.front_end = FrontEnd(matcher, config.odometry if log.has_odometry else None, config.front_end)
        self._steps: GrowingRows[np.float64] = GrowingRows((3,), np.float64)
        self._key_of_scan: GrowingRows[np.int64] = GrowingRows((), np.int64)
        self._T_track_scan: GrowingRows[np.float64] = GrowingRows((3,), np.float64)

    def __len__(self) -> int:
        """Number of scans tracked."""
        return len(self._key_of_scan)

    def advance(self) -> None:
        """Track the next scan of the log, which is there."""
        index, front_end, log = len(self._key_of_scan), self.front_end, self._log
        step = self._step(index)
        self._expect_reach(index)
        is_sudden = self._stands_out(sudden_steps, index)
        self._steps.append(step)
        together = slice(index, index + (log.has_odometry and index > 0 and not is_sudden))
        ranges = beyond(log.ranges[index : index + 1], self._own_body)
        steps = self._steps.rows[together]
        found = front_end.follow(index, ranges[: len(steps)], steps, log.geometry)
        if len(found):
            pose = found[-1]
        else:
            scan = Scan(ranges=ranges[0], geometry=log.geometry)
            odometry = step if log.has_odometry and index else None
            is_late = self._stands_out(late_steps, index)
            wait = self._wait(index)
            pose = front_end.add(index, scan, odometry, is_sudden=is_sudden, is_late=is_late, wait=wait)
        self._key_of_scan.append(len(front_end.keys) - 1)
        self._T_track_scan.append(pose)
        if self._is_first_part and self._is_enough(index):
            self._calibrate()

    def motion_to(self, key: int) -> OdometryMotion | None:
        """Calibrated odometry from the key scan before to this one, None where it does not know the way."""
        first, last = (self.front_end.keys[k].index for k in (key - 1, key))
        breaks = self.front_end.breaks
        if not self._log.has_odometry or bisect_right(breaks, first) < bisect_right(breaks, last):
            return None
        noise = self.calibration.lasting_noise
        return noise.extend(noise.start(), self._steps.rows[first + 1 : last + 1])

    @property
    def T_key_robot(self) -> Floats:
        """(3,) where the robot is, seen from the newest key scan."""
        return between(self.front_end.keys[-1].T_track_robot, self._T_track_scan.rows[-1])

    def track(self) -> Track:
        """The track so far."""
        return self.front_end.track(self._key_of_scan.rows.copy(), self._T_track_scan.rows)

    def _step(self, index: int) -> Floats:
        """(3,) calibrated odometry since the scan before, zero without."""
        if not (self._log.has_odometry and index):
            return np.zeros(3)
        odometry = self._log.odometry[max(0, index - _RECENT) : index + 1]
        if not self._is_first_part:
            odometry = self.calibration.apply(odometry, self._config.front_end.calibration.sudden)
        return between(odometry[-2], odometry[-1])

    def _expect_reach(self, index: int) -> None:
        """Say how far the robot gets from scan to scan, by its newest steps: now and then, it changes slowly."""
        if self._log.has_odometry and index and (index < _SELDOM or index % _SELDOM == 0):
            recent, share = self._recent(index), self._config.front_end.calibration.sudden.nearly_all
            self.front_end.expect(usual_reach(self._log.odometry[recent], share, self._log.stamps[recent]))

    def _wait(self, index: int) -> float:
        """Time since the scan before, in usual intervals."""
        return float(waits(self._log.stamps[self._recent(index)])[-1]) if index else 1.0

    def _stands_out(self, told: Callable[..., Bools], index: int) -> bool:
        """Whether odometry since the scan before is one of the steps that `sudden_steps` or `late_steps` tell."""
        if not (self._log.has_odometry and index):
            return False
        recent, config = self._recent(index), self._config.front_end.calibration.sudden
        x, y, turn = between(*self._log.odometry[index - 1 : index + 1]).tolist()
        if math.hypot(x, y) <= config.distance and abs(turn) <= config.turn:
            return False  # as nearly all steps; to compare it with the recent ones takes longer than to track a scan
        return bool(told(self._log.odometry[recent], config, self._log.stamps[recent])[-1])

    @staticmethod
    def _recent(index: int) -> slice:
        return slice(max(0, index - _RECENT), index + 1)

    def _is_enough(self, index: int) -> bool:
        """Whether the robot has driven and turned enough to tell what its odometry does wrong."""
        front_end, (x, y, turn) = self._config.front_end, self._steps.rows[-1]
        self._path += float(np.hypot(x, y))
        self._turn += abs(float(turn))
        has_driven = self._path > front_end.calibration_path and self._turn > front_end.calibration_turn
        return has_driven or index + 1 >= front_end.calibration_scans

    def _calibrate(self) -> None:
        self._is_first_part = False
        self.calibration = calibrate_odometry(self.track(), self._log.odometry, self._config.front_end.calibration)
        self.front_end.trust(self.calibration.noise)
