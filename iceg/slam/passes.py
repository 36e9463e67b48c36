"""The passes over a log: what one tells of velocity, gyro, sweep and mount serves the next."""

from frontends.scan import Log
from iceg.config import Config
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.odometry.calibration import OdometryCalibration
from iceg.slam.odometry.foretold_steps import foretold_steps
from iceg.slam.odometry.gyro import learn_gyro
from iceg.slam.progress import ProgressCallback
from iceg.slam.sweep.tracking import Followed, SweepFinding, track_swept
from iceg.slam.track import Track
from iceg.slam.tracking.laser_orientation import track_as_mounted
from iceg.slam.tracking.laser_place import placed_by_odometry
from iceg.slam.tracking.log_tracking import NOTHING_FOREKNOWN, Foreknown, track_calibrating


def track_guided(
    log: Log, matcher: MapMatcher, config: Config, progress: ProgressCallback | None
) -> tuple[Followed, Foreknown]:
    """Track a log; where it has no odometry once more, guided by what the matches tell of velocity and gyro.

    Args:
        log: the log.
        matcher: ICE or any other.
        config: all settings.
        progress: called as scans are followed.

    Returns:
        The log, corrected if its laser is mounted otherwise than it says, its track and the calibration on the way; and
        what guided it.
    """
    followed = _follow(log, matcher, config, progress, NOTHING_FOREKNOWN)
    track, calibration = followed[1], config.front_end.calibration
    if log.has_odometry and not track.dead:
        return followed, NOTHING_FOREKNOWN
    heading, _ = learn_gyro(track, log, config.front_end)
    foreknown = Foreknown(heading=heading, steps=foretold_steps(track, log.stamps, calibration, heading))
    return (followed if foreknown.steps is None else _follow(log, matcher, config, progress, foreknown)), foreknown


def track_with_sweep(
    followed: Followed, matcher: MapMatcher, config: Config, progress: ProgressCallback | None, foreknown: Foreknown
) -> tuple[Followed, SweepFinding]:
    """Track a log again with its beams moved by the motion within each sweep, where that is known and asked for.

    Args:
        followed: what `track_guided` returned, …
        matcher: ICE or any other.
        config: all settings.
        progress: called as scans are followed.
        foreknown: … both parts of it.

    Returns:
        The same of the last pass, and what is known of the sweep.
    """
    if not config.front_end.deskew:
        return followed, SweepFinding(source="nothing")
    return track_swept(followed, lambda log: _follow(log, matcher, config, progress, foreknown), config.front_end.sweep)


def track_placed(
    followed: Followed, matcher: MapMatcher, config: Config, progress: ProgressCallback | None, foreknown: Foreknown
) -> Followed:
    """Track a log again with its laser where the odometry says it sits, where the log does not say it.

    Args:
        followed: what `track_with_sweep` returned; before, the sweep would pass for a laser that sits aside.
        matcher: ICE or any other.
        config: all settings.
        progress: called as scans are followed.
        foreknown: what guided the passes before.
    """
    if not config.front_end.calibrate_odometry:
        return followed
    placed = placed_by_odometry(followed[0], followed[1], config.front_end.calibration)
    return followed if placed is None else _follow(placed, matcher, config, progress, foreknown)


def _follow(
    log: Log, matcher: MapMatcher, config: Config, progress: ProgressCallback | None, foreknown: Foreknown
) -> Followed:
    def follow(log: Log) -> tuple[Track, OdometryCalibration]:
        return track_calibrating(log, matcher, config.odometry, config.front_end, progress, foreknown)

    return track_as_mounted(log, follow, config.front_end.mount)
