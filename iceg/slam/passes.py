"""The passes over a log: what one tells of velocity, gyro, sweep and mount serves the next."""

from dataclasses import dataclass, replace

from frontends.scan import Log
from iceg.config import Config
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.odometry.calibration import OdometryCalibration
from iceg.slam.odometry.foretold_steps import foretold_steps
from iceg.slam.odometry.gyro import learn_gyro
from iceg.slam.odometry.worth import error_beside_velocity, without_odometry
from iceg.slam.progress import Progress, ProgressCallback
from iceg.slam.sweep.tracking import Followed, SweepFinding, track_swept
from iceg.slam.track import Track
from iceg.slam.tracking.laser_orientation import track_as_mounted
from iceg.slam.tracking.laser_place import placed_by_odometry
from iceg.slam.tracking.log_tracking import NOTHING_FOREKNOWN, Foreknown, track_calibrating


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracker:
    """Tracks a log, as often as one pass tells what helps the next.

    Attributes:
        matcher: ICE or any other.
        config: all settings.
        progress: called as scans are followed.
        foreknown: what the passes before tell of the motion.
    """

    matcher: MapMatcher
    config: Config
    progress: ProgressCallback | None = None
    foreknown: Foreknown = NOTHING_FOREKNOWN

    def follow(self, log: Log) -> Followed:
        """One pass over a log whose laser is mounted as it says."""
        return (log, *self._once(log))

    def guided(self, log: Log) -> tuple[Followed, "Tracker"]:
        """Track a log; where it has no odometry once more, guided by what the matches tell of velocity and gyro.

        Returns:
            The log, corrected if its laser is mounted otherwise than it says, and without an odometry that tells less
            than the velocity does; its track and the calibration on the way; and the tracker that knows what guided it.
        """
        tracks: list[Track] = []

        def follow(log: Log) -> tuple[Track, OdometryCalibration]:
            found = self._once(log)
            tracks.append(found[0])
            return found

        followed = track_as_mounted(log, follow, self.config.front_end.mount)
        if self._is_velocity_better(*followed):
            log = without_odometry(followed[0])
            alone = (log, *follow(log))
            if alone[1].failures <= followed[1].failures:  # else odometry leads past scans that see nothing
                followed = alone
        log, track, _ = followed
        if self.progress is not None and tracks[-1] is not track:  # what was told last does not count
            tried = len(log) - 1
            self.progress(Progress(scans=len(log), tried=tried, accepted=tried - track.failures))
        if log.has_odometry and not track.dead:
            return followed, self
        heading, _ = learn_gyro(track, log, self.config.front_end)
        steps = foretold_steps(track, log.stamps, self.config.front_end.calibration, heading)
        tracker = replace(self, foreknown=Foreknown(heading=heading, steps=steps))
        return followed if steps is None else tracker.follow(log), tracker

    def with_sweep(self, followed: Followed) -> tuple[Followed, SweepFinding]:
        """Track a log again, its beams moved by the motion within each sweep, where that is known and asked for.

        Args:
            followed: what `guided` returned.

        Returns:
            The same of the last pass, and what is known of the sweep.
        """
        if not self.config.front_end.deskew:
            return followed, SweepFinding(source="nothing")
        return track_swept(followed, self.follow, self.config.front_end.sweep)

    def placed(self, followed: Followed) -> Followed:
        """Track a log again with its laser where the odometry says it sits, where the log does not say it.

        Args:
            followed: what `with_sweep` returned; before, the sweep would pass for a laser that sits aside.
        """
        if not self.config.front_end.calibrate_odometry:
            return followed
        placed = placed_by_odometry(followed[0], followed[1], self.config.front_end.calibration)
        return followed if placed is None else self.follow(placed)

    def _is_velocity_better(self, log: Log, track: Track, calibration: OdometryCalibration) -> bool:
        """Whether the velocity knows how far the robot came, and odometry does not."""
        config = self.config.front_end
        if not (log.has_odometry and config.calibrate_odometry) or track.dead:
            return False
        error = error_beside_velocity(track, log.stamps, calibration.noise, config.calibration)
        return error > config.calibration.worse_than_velocity

    def _once(self, log: Log) -> tuple[Track, OdometryCalibration]:
        noise, config = self.config.odometry, self.config.front_end
        return track_calibrating(log, self.matcher, noise, config, self.progress, self.foreknown)
