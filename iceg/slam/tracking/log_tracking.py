"""The front end over a whole log; what its odometry does wrong is learnt on the way."""

from bisect import bisect_left
from dataclasses import dataclass, replace

import numpy as np

from frontends.scan import Log
from graph.arrays import Floats
from graph.odometry import OdometryModel
from graph.se2 import between
from iceg.slam.config import FrontEndConfig
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.odometry.calibration import OdometryCalibration, calibrate_odometry
from iceg.slam.odometry.heading_odometry import HeadingOdometry
from iceg.slam.progress import Progress, ProgressCallback
from iceg.slam.recording.intervals import waits
from iceg.slam.recording.standstill import dead_intervals
from iceg.slam.recording.steps import late_steps, sudden_steps, usual_reach
from iceg.slam.track import Track
from iceg.slam.tracking.front_end import FrontEnd

_MOST_TOGETHER = 256
"""Scans that are followed before progress is told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Foreknown:
    """What an earlier pass tells of the motion of a robot where odometry does not.

    Attributes:
        heading: how it turned, by a gyro; None for nothing.
        steps: (n_scans - 1, 3) the step to every scan but the first, in the frame of the one before; None for nothing.
    """

    heading: HeadingOdometry | None = None
    steps: Floats | None = None


NOTHING_FOREKNOWN = Foreknown()
"""As in a first pass."""


def track_log(log: Log, matcher: MapMatcher, noise: OdometryModel, config: FrontEndConfig) -> Track:
    """Run the front end over a log with its odometry as it is, of which only the noise is known."""
    return track_calibrating(log, matcher, noise, replace(config, calibrate_odometry=False))[0]


def track_calibrating(
    log: Log,
    matcher: MapMatcher,
    noise: OdometryModel,
    config: FrontEndConfig,
    progress: ProgressCallback | None = None,
    foreknown: Foreknown = NOTHING_FOREKNOWN,
) -> tuple[Track, OdometryCalibration]:
    """Run the front end over a log; what its first part tells about the odometry helps with the rest.

    Where odometry had to carry a scan of the first part, or was late, that part is tracked again with the better one.

    Args:
        log: the log.
        matcher: ICE or any other.
        noise: of the odometry, before anything is known.
        config: key scans, local reference and calibration.
        progress: called as scans are followed.
        foreknown: what an earlier pass tells where there is no odometry.

    Returns:
        The track, and the calibration from the first part.
    """
    calibration = OdometryCalibration(noise=noise, lasting_noise=noise)
    journey = _Journey(log, matcher, noise, config, progress, foreknown)
    odometry = log.odometry
    if log.has_odometry and config.calibrate_odometry and len(log) > 1:
        n_first = _enough_to_calibrate(log, config)
        journey.advance(n_first, odometry)
        first = journey.track()
        calibration = calibrate_odometry(first, log.odometry[:n_first], config.calibration)
        odometry = calibration.apply(log.odometry, config.calibration.sudden)
        if first.failures or calibration.is_late(config.calibration):
            journey = _Journey(log, matcher, calibration.noise, config, progress, foreknown)
        journey.front_end.trust(calibration.noise)
    journey.advance(len(log), odometry)
    return journey.track(), calibration


def _enough_to_calibrate(log: Log, config: FrontEndConfig) -> int:
    """How many scans it takes until the robot has driven and turned enough."""
    steps = between(log.odometry[:-1], log.odometry[1:])
    path, turn = np.cumsum(np.hypot(steps[:, 0], steps[:, 1])), np.cumsum(np.abs(steps[:, 2]))
    enough = (path > config.calibration_path) & (turn > config.calibration_turn)
    return min(int(np.argmax(enough)) + 1 if enough.any() else len(log), config.calibration_scans)


class _Journey:
    """A front end on its way through a log."""

    def __init__(
        self,
        log: Log,
        matcher: MapMatcher,
        noise: OdometryModel,
        config: FrontEndConfig,
        progress: ProgressCallback | None,
        foreknown: Foreknown,
    ) -> None:
        self._log = log
        self._min_motion = config.standstill.min_motion
        self._progress = progress
        self._foretold = foreknown.steps
        self.front_end = FrontEnd(matcher, noise if log.has_odometry else None, config, foreknown.heading)
        self._sudden = sudden_steps(log.odometry, config.calibration.sudden, log.stamps)
        self._late = late_steps(log.odometry, config.calibration.sudden, log.stamps)
        self._waits = waits(log.stamps)
        self.front_end.expect(usual_reach(log.odometry, config.calibration.sudden.nearly_all, log.stamps))
        self._dead = dead_intervals(log.odometry, log.ranges, config.standstill) if log.has_odometry else []
        self._is_known = np.full(len(log) - 1, log.has_odometry)
        for first, last in self._dead:  # nor does odometry know the step with which it wakes
            self._is_known[first : last + 1] = False
        self._not_plain = np.flatnonzero(~np.append(False, self._is_known & ~self._sudden)).tolist()
        self._key_of_scan: list[int] = []
        self._T_track_scans: list[Floats] = []

    def advance(self, end: int, odometry: Floats) -> None:
        """Track all scans before `end` that were not yet, predicted by (n_scans, 3) odometry."""
        steps = np.concatenate([np.zeros((1, 3)), between(odometry[: end - 1], odometry[1:end])])
        while len(self._key_of_scan) < end:
            if not self._follow(end, steps):
                self._add(steps)
            if self._progress is not None:
                tried = len(self._key_of_scan) - 1
                accepted = tried - self.front_end.failures
                self._progress(Progress(scans=tried + 1, tried=tried, accepted=accepted))

    def _follow(self, end: int, steps: Floats) -> bool:
        """Track the next scans before `end` together, by (end, 3) steps, as far as they are plain; whether any was."""
        log, front_end, index = self._log, self.front_end, len(self._key_of_scan)
        following = bisect_left(self._not_plain, index)
        stop = min(end, index + _MOST_TOGETHER, *self._not_plain[following : following + 1])
        key = len(front_end.keys) - 1
        poses = front_end.follow(index, log.ranges[index:stop], steps[index:stop], log.geometry)
        self._T_track_scans += list(poses)
        self._key_of_scan += [key] * len(poses)
        if len(poses):
            self._key_of_scan[-1] = len(front_end.keys) - 1
        return len(poses) > 0

    def _add(self, steps: Floats) -> None:
        """Track the next scan by itself."""
        index = len(self._key_of_scan)
        is_known = index > 0 and bool(self._is_known[index - 1])
        is_sudden, is_late = (is_known and bool(steps[index - 1]) for steps in (self._sudden, self._late))
        wait = float(self._waits[index - 1]) if index else 1.0
        step = steps[index] if is_known else None
        foretold = None if self._foretold is None or index == 0 else self._foretold[index - 1]
        pose = self.front_end.add(
            index, self._log.scan(index), step, is_sudden=is_sudden, is_late=is_late, wait=wait, foretold=foretold
        )
        self._T_track_scans.append(pose)
        self._key_of_scan.append(len(self.front_end.keys) - 1)

    def track(self) -> Track:
        """The track so far."""
        T_track_scans = np.array(self._T_track_scans)
        dead = [interval for interval in self._dead if self._may_have_moved(T_track_scans, *interval)]
        return self.front_end.track(np.array(self._key_of_scan, dtype=np.int64), T_track_scans, dead)

    def _may_have_moved(self, T_track_scans: Floats, first: int, last: int) -> bool:
        """Whether the scans of an interval tell of a motion, or nothing tells of any."""
        is_unknown = any(first < scan <= last for scan in self.front_end.unknown_motion)
        T_first_scan = between(T_track_scans[first : first + 1], T_track_scans[first:last])
        return is_unknown or bool((np.abs(T_first_scan) > self._min_motion).any())
