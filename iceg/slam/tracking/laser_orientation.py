"""How the laser sits on the robot, where the log does not say it or says it wrongly: turned about, or upside down.

Matches follow a robot whatever its odometry says, if the scans are dense enough. Where they turn against the odometry,
the beams run the other way round than they are taken to; where the robot moves elsewhere than the odometry says, the
laser looks elsewhere than it is taken to. A few degrees are the business of the calibration.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from frontends.scan import Log
from graph.arrays import Floats
from graph.elementary import arctan2, cos_sin
from graph.measurement import NoMatch
from graph.se2 import between, compose, wrap_angle
from iceg.slam.odometry.calibration import OdometryCalibration
from iceg.slam.track import Track
from iceg.slam.tracking.front_end import COVERED
from iceg.slam.tracking_config import MountConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserOrientation:
    """Where the laser looks, against what the log says.

    Attributes:
        is_mirrored: its beams run the other way round.
        heading: by how much it is turned [rad].
    """

    is_mirrored: bool = False
    heading: float = 0.0

    @property
    def is_as_said(self) -> bool:
        """Whether the log is right."""
        return not self.is_mirrored and self.heading == 0.0

    def corrected(self, log: Log) -> Log:
        """The log as it would be if the laser sat where it says, and a sentence about it among its warnings."""
        if self.is_mirrored:
            geometry = replace(log.geometry, bearings=-log.geometry.bearings[::-1])
            ranges = np.ascontiguousarray(log.ranges[:, ::-1])
            warning = (
                "the scans turn against the odometry: the beams are taken the other way round, as of a laser that is "
                "mounted upside down; if it is the odometry that counts turns clockwise, the map is a mirror image"
            )
            sweep = None if log.sweep is None else -log.sweep
            log = replace(log, ranges=ranges, geometry=geometry, sweep=sweep, warnings=(*log.warnings, warning))
        if self.heading:
            warning = (
                f"the scans move at {math.degrees(self.heading):.0f}° to the odometry: the laser looks there, seen "
                "from where the log says it does; the heading of the trajectory fits the log's pose of the laser"
            )
            turned = compose(log.odometry, np.array([0.0, 0.0, self.heading]))
            log = replace(log, odometry=turned, warnings=(*log.warnings, warning))
        return log


_BACKWARDS = LaserOrientation(heading=math.pi)
_MOST_CORRECTIONS = 2
"""A laser may be mounted upside down and turned."""


def track_as_mounted(
    log: Log, follow: Callable[[Log], tuple[Track, OdometryCalibration]], config: MountConfig
) -> tuple[Log, Track, OdometryCalibration]:
    """Track a log; once more with a corrected one where the laser turns out to be mounted otherwise than it says.

    Args:
        log: the log.
        follow: tracks one.
        config: what it takes to be believed.

    Returns:
        The log, corrected if need be, and what tracking it gave.
    """
    track, calibration = follow(log)
    if not log.has_odometry:
        return log, track, calibration
    for _ in range(_MOST_CORRECTIONS):
        orientation = laser_orientation(track, log.odometry, config)
        if orientation.is_as_said:
            break
        log = orientation.corrected(log)
        track, calibration = follow(log)
    lost = _share_lost(track)
    if lost > config.lost_share:
        turned = _BACKWARDS.corrected(log)
        turned_track, turned_calibration = follow(turned)
        if _share_lost(turned_track) < config.lost_gain * lost:
            return turned, turned_track, turned_calibration
    return log, track, calibration


def laser_orientation(track: Track, odometry: Floats, config: MountConfig) -> LaserOrientation:
    """What the matches of a track say about how its laser is mounted.

    Args:
        track: what the front end found.
        odometry: (n, 3) of the log.
        config: what it takes.

    Returns:
        As the log says, unless the matches contradict it clearly. Where beams run the other way round, directions say
        nothing yet: they do once the log is corrected.
    """
    seen, claimed = _motions(track, odometry)
    if _turns_against(seen[:, 2], claimed[:, 2], config):
        return LaserOrientation(is_mirrored=True)
    return LaserOrientation(heading=_heading(seen, claimed, config))


def _motions(track: Track, odometry: Floats) -> tuple[Floats, Floats]:
    """(n, 3) motions between key scans that were matched, as the matches see them and as odometry claims them."""
    unknown = track.keys_without_odometry()
    keys = [k for k, key in enumerate(track.keys) if k and not isinstance(key.match, NoMatch) and k not in unknown]
    after = np.array(keys, dtype=np.int64)
    seen, claimed = track.T_track_keys, odometry[track.key_scans]
    return between(seen[after - 1], seen[after]), between(claimed[after - 1], claimed[after])


def _turns_against(seen: Floats, claimed: Floats, config: MountConfig) -> bool:
    """Whether turns seen, (n,), have the sense opposite to those claimed, and about their size."""
    least = np.minimum(np.abs(seen), np.abs(claimed))
    telling = (least > config.min_turn) & (least < config.max_turn)
    against = telling & (seen * claimed < 0.0)
    share = config.against_share * float(least[telling].sum())
    return int(against.sum()) >= config.min_motions and float(least[against].sum()) >= share


def _heading(seen: Floats, claimed: Floats, config: MountConfig) -> float:
    """By how much the laser is turned [rad], 0 where that is little.

    Along a corridor a match follows odometry wherever it goes: some of the motions are enough if they agree.
    """
    lengths = np.minimum(np.hypot(seen[:, 0], seen[:, 1]), np.hypot(claimed[:, 0], claimed[:, 1]))
    turns = np.maximum(np.abs(seen[:, 2]), np.abs(claimed[:, 2]))
    straight = (lengths > config.straight_distance) & (turns < config.straight_turn)
    directions = wrap_angle(_direction(claimed[straight]) - _direction(seen[straight]))
    askew = directions[np.abs(directions) > config.askew]
    if len(askew) < max(config.min_motions, config.askew_share * len(directions)):
        return 0.0
    cos, sin = (float(part.mean()) for part in cos_sin(askew))
    return math.atan2(sin, cos) if math.hypot(sin, cos) > config.askew_agreement else 0.0


def _share_lost(track: Track) -> float:
    """Share of the key scans that match nothing, of those that see something."""
    matches = [key.match for key in track.keys[1:] if key.match != COVERED]
    return sum(isinstance(match, NoMatch) for match in matches) / max(1, len(matches))


def _direction(motions: Floats) -> Floats:
    return arctan2(motions[:, 1], motions[:, 0])
