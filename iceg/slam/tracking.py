"""The front end over a whole log; what its odometry does wrong is learnt on the way."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from frontends.matcher import Matcher
from frontends.scan import Log
from graph.odometry import OdometryModel
from graph.se2 import between
from iceg.slam.config import FrontEndConfig
from iceg.slam.front_end import FrontEnd
from iceg.slam.odometry_calibration import OdometryCalibration, calibrate_odometry
from iceg.slam.odometry_standstill import dead_stretches
from iceg.slam.odometry_steps import sudden_steps
from iceg.slam.track import Track

_MOVED = 0.3
"""Farther than this [m, rad] a robot that stands is not seen to be."""


def track_log(
    log: Log,
    matcher: Matcher,
    noise: OdometryModel,
    config: FrontEndConfig,
    progress: Callable[[int, int], None] | None = None,
    n_scans: int | None = None,
) -> Track:
    """Run the front end over a log with its odometry as it is.

    Args:
        log: the log.
        matcher: ICE or any other.
        noise: of the odometry.
        config: key scans and local reference.
        progress: called with the number of scans done and of failures so far.
        n_scans: stop after so many.

    Returns:
        The track.
    """
    journey = _Journey(log, matcher, noise, config, progress)
    journey.advance(len(log) if n_scans is None else min(n_scans, len(log)), log.odometry)
    return journey.track()


def track_calibrating(
    log: Log,
    matcher: Matcher,
    noise: OdometryModel,
    config: FrontEndConfig,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Track, OdometryCalibration]:
    """Run the front end over a log; what its first part tells about the odometry helps with the rest.

    Where odometry had to carry a scan of the first part, that part is tracked again with the better odometry.

    Args:
        log: the log.
        matcher: ICE or any other.
        noise: of the odometry, before anything is known.
        config: key scans, local reference and calibration.
        progress: called with the number of scans done and of failures so far.

    Returns:
        The track, and the calibration from the first part.
    """
    calibration = OdometryCalibration(noise=noise, lasting_noise=noise)
    journey = _Journey(log, matcher, noise, config, progress)
    odometry = log.odometry
    if log.has_odometry and config.calibrate_odometry and len(log) > 1:
        n_first = _enough_to_calibrate(log, config)
        journey.advance(n_first, odometry)
        first = journey.track()
        calibration = calibrate_odometry(first, log.odometry[:n_first])
        odometry = calibration.apply(log.odometry)
        if first.failures:
            journey = _Journey(log, matcher, calibration.noise, config, progress)
        journey.trust(calibration.noise)
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
        matcher: Matcher,
        noise: OdometryModel,
        config: FrontEndConfig,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self._log = log
        self._progress = progress
        self._front_end = FrontEnd(matcher, noise if log.has_odometry else None, config)
        self._sudden = sudden_steps(log.odometry, log.stamps)
        self._dead = dead_stretches(log.odometry, log.ranges) if log.has_odometry else []
        self._is_known = _known_steps(self._dead, len(log))
        self._key_of_scan: list[int] = []
        self._T_track_scan: list[NDArray[np.float64]] = []

    def trust(self, noise: OdometryModel) -> None:
        """Believe the odometry so much from here on."""
        self._front_end.trust(noise)

    def advance(self, end: int, odometry: NDArray[np.float64]) -> None:
        """Track all scans before `end` that were not yet, predicted by (n_scans, 3) odometry."""
        log, front_end = self._log, self._front_end
        start = len(self._key_of_scan)
        steps = between(odometry[max(start - 1, 0) : end - 1], odometry[max(start, 1) : end])
        for index in range(start, end):
            is_known = log.has_odometry and index > 0 and self._is_known[index - 1]
            step = steps[index - max(start, 1)] if is_known else None
            is_sudden = step is not None and bool(self._sudden[index - 1])
            self._T_track_scan.append(front_end.add(index, log.scan(index), step, is_sudden=is_sudden))
            self._key_of_scan.append(len(front_end.keys) - 1)
            if self._progress is not None:
                self._progress(index + 1, front_end.failures)

    def track(self) -> Track:
        """The track so far."""
        front_end = self._front_end
        T_track_keys = np.array([key.T_track_robot for key in front_end.keys])
        key_of_scan = np.array(self._key_of_scan, dtype=np.int64)
        T_track_scan = np.array(self._T_track_scan)
        return Track(
            keys=list(front_end.keys),
            key_of_scan=key_of_scan,
            T_key_scan=between(T_track_keys[key_of_scan], T_track_scan),
            failures=front_end.failures,
            lost=list(front_end.lost),
            breaks=list(front_end.breaks),
            adrift=list(front_end.adrift),
            dead=[stretch for stretch in self._dead if _has_moved(T_track_scan[slice(*stretch)])],
        )


def _has_moved(poses: NDArray[np.float64]) -> bool:
    """Whether the robot left the first of (n, 3) poses, as far as its scans tell."""
    T_first_pose = between(poses[:1], poses)
    return bool((np.abs(T_first_pose) > _MOVED).any())


def _known_steps(dead: list[tuple[int, int]], n_scans: int) -> list[bool]:
    """(n_scans - 1,) which steps odometry knows: not those where it is dead, nor the one with which it wakes."""
    is_known = [True] * (n_scans - 1)
    for first, last in dead:
        is_known[first : last + 1] = [False] * len(is_known[first : last + 1])
    return is_known
