"""SLAM as scans come: the newest pose after every scan, the map at any time, and in the end what `iceg.run` gives."""

from dataclasses import dataclass, replace
from enum import Enum
from math import sqrt
from pathlib import Path
from types import NoneType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from frontends.checked_arguments import expect
from frontends.growing_log import GrowingLog
from frontends.laser_noise import LaserNoise
from frontends.scan import Log, ScanGeometry
from graph.counted import counted
from graph.dense import congruence, inv
from graph.measurement import NoMatch
from graph.se2 import adjoint, compose, compose_covariance, inverse
from graph.short_repr import short_repr
from iceg.config import Config
from iceg.corrections.corrections import Corrections
from iceg.finding import laser_noise, matcher_of
from iceg.ice.noise import PLAIN, beyond_allowed
from iceg.maps.feature_map import Landmarks
from iceg.maps.grid import OccupancyGrid
from iceg.pipeline import conclude, grid_of, landmarks_of, run
from iceg.run_result.slam_result import SlamResult
from iceg.show.progress import prepare_kernels
from iceg.slam.findings import Findings
from iceg.slam.incremental_graph import IncrementalGraph
from iceg.slam.incremental_tracking import IncrementalTracking
from iceg.slam.kept_scans import KeptScans
from iceg.slam.noise_widths import widened
from iceg.slam.progress import ProgressCallback
from iceg.slam.recording.own_body import beyond, own_limits
from iceg.slam.stage_clock import StageClock
from iceg.slam.stages import IN_HOUSE, Stages
from iceg.slam.sweep.tracking import SweepFinding
from iceg.slam.track import KeyScan

_TELLING = 100
"""Scans after which the noise of the laser is known …"""
_ASKED_AGAIN = (_TELLING, 200, 400, 800, 1600)
"""… and those after which it is asked whether the laser sees the robot: that takes different places."""


class Event(Enum):
    """What became of a scan."""

    FIRST = "first scan"
    MATCHED = "matched"
    KEY_SCAN = "key scan"
    LOOP_CLOSED = "closed a loop"
    CARRIED = "carried by odometry"
    LOST = "lost"
    COVERED = "covered"


@dataclass(frozen=True, slots=True, kw_only=True)
class MapperUpdate:
    """Where the robot is after one more scan.

    Attributes:
        scan: which one, counted from 0.
        pose: (3,) T_map_robot: x [m], y [m], heading [rad].
        covariance: (3, 3) of it in the tangent space at it, order x, y, θ.
        event: what happened; a closed loop before all else.
        is_key_scan: whether the scan became a node of the graph.
    """

    scan: int
    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    event: Event
    is_key_scan: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class MapperMap:
    """The maps as they stand.

    Attributes:
        grid: the occupancy grid.
        landmarks: the feature map, expired landmarks included.
    """

    grid: OccupancyGrid
    landmarks: Landmarks

    __repr__ = short_repr


class Mapper:
    """Maps while scans come in.

    The front end tracks each scan and the back end grows the graph in iSAM2, the same that `iceg.run` drives over a
    whole log. What only a whole log tells (noise of odometry and laser throughout, motion within a sweep, matching
    again, poses and walls refined together) is left to `finish`.
    """

    def __init__(
        self,
        geometry: ScanGeometry,
        config: Config | None = None,
        *,
        stages: Stages | None = None,
        name: str = "log",
        is_mount_known: bool = True,
    ) -> None:
        """Start with an empty map.

        Args:
            geometry: the laser; readings outside its limits are no returns.
            config: settings; the defaults when left out.
            stages: those that are replaced by functions of one's own.
            name: what the log is called.
            is_mount_known: whether the geometry says where the laser sits on the robot; if not, `finish` learns it from
                the odometry, as `iceg.run` does. `add` takes the geometry as it is.

        The first one on a machine waits here until the kernels are compiled, so that no scan has to.

        Raises:
            TypeError: an argument of another type.
        """
        expect(geometry, ScanGeometry, "geometry", "iceg.ScanGeometry, as a log has")
        expect(config, (Config, NoneType), "config", "iceg.Config, as iceg.read_config(path) gives")
        expect(stages, (Stages, NoneType), "stages", "iceg.Stages")
        prepare_kernels()
        self._given = config or Config()
        self._stages = stages or IN_HOUSE
        self._log = GrowingLog(geometry, Path(name), is_mount_known=is_mount_known)
        self._laser: LaserNoise | None = None
        self._own_body = np.full(geometry.n_beams, self._given.front_end.own_body.nearest)

    def __repr__(self) -> str:
        return f"Mapper({counted(len(self), 'scan')} of {len(self._own_body)} beams)"

    def __len__(self) -> int:
        """Number of scans so far."""
        return len(self._log)

    def add(self, ranges: ArrayLike, odometry: ArrayLike | None = None, stamp: float | None = None) -> MapperUpdate:
        """Take one more scan.

        Args:
            ranges: (n_beams,) readings [m].
            odometry: (3,) x [m], y [m], heading [rad] of the robot by its wheels, as they stand at this scan; None for
                a log without.
            stamp: when it was taken [s]; None for a log without.

        Returns:
            Where the robot is, and what happened.

        Raises:
            ScanError: what came is no such scan, see `Log.from_arrays`; it is left out.
        """
        self._log.append(ranges, odometry, stamp)
        index = len(self._log) - 1
        if index == 0:
            self._begin()
            return self._update(Event.FIRST, is_key=True)
        if index in _ASKED_AGAIN:
            self._learn_the_laser()
        return self._advance()

    def map(self) -> MapperMap:
        """The maps as they stand, all scans so far drawn along the trajectory as it is estimated now.

        Raises:
            ScanError: there is no scan yet.
        """
        log, track, poses = self._seen(), self._tracking.track(), self._graph.poses
        config = self._config
        grid, _ = grid_of(log, track.trajectory(poses), config, self._stages)
        return MapperMap(grid=grid, landmarks=landmarks_of(track, poses, self._matcher, config))

    def result(self) -> SlamResult:
        """Everything that is known so far, as `iceg.run` returns it, but without the finish; the mapper may go on.

        Raises:
            ScanError: there is no scan yet.
        """
        log = self._seen()
        findings = Findings(
            log=log,
            kept=KeptScans.all_of(len(log)),
            config=replace(self._given, finish=replace(self._given.finish, enabled=False)),
            has_own_stages=self._stages != IN_HOUSE,
            laser=self._laser,
            sweep=SweepFinding(source="nothing").record(),
            gyro=None,
            track=self._tracking.track(),
            calibration=self._tracking.calibration,
            solution=self._graph.solution(),
        )
        return conclude(findings, Corrections(), self._matcher, StageClock(), self._stages)

    def finish(self, progress: ProgressCallback | None = None) -> SlamResult:
        """What `iceg.run` gives on the scans so far, to the byte, for it is what it does; the mapper may go on.

        All scans are tracked again, with what is learned from all of them.

        Args:
            progress: called as the front end proceeds.

        Raises:
            ScanError: there is no scan yet.
        """
        return run(self._log.log(), self._given, progress, stages=self._stages)

    def _begin(self) -> None:
        """Track the scans so far from the first on, with what is known of the laser."""
        noise = beyond_allowed(self._laser)
        self._config = widened(self._given, sqrt(noise.typical))
        self._matcher = matcher_of(self._config, noise, self._stages)
        self._tracking = IncrementalTracking(self._log, self._matcher, self._config, self._own_body)
        self._tracking.advance()
        front_end = self._tracking.front_end
        self._graph = IncrementalGraph(front_end.keys, front_end.lost, self._matcher, self._config, self._stages)

    def _learn_the_laser(self) -> None:
        """Begin anew with the noise of the laser once it is known, or where more of it sees the robot itself."""
        own = own_limits(self._log.ranges, self._log.geometry, self._given.front_end.own_body)
        is_new = bool((own > self._own_body).any())
        if is_new:
            self._own_body = own
        if len(self) == _TELLING + 1:
            self._laser = laser_noise(self._seen(), self._given)
            is_new = is_new or beyond_allowed(self._laser) != PLAIN
        if is_new:
            self._begin()
            for _ in range(len(self) - 2):
                self._advance()

    def _seen(self) -> Log:
        """The scans so far without what the robot itself returns.

        Raises:
            ScanError: there is none.
        """
        log = self._log.log()
        return replace(log, ranges=beyond(log.ranges, self._own_body))

    def _advance(self) -> MapperUpdate:
        """Track the next scan of the log, and go on with the graph."""
        front_end = self._tracking.front_end
        n_keys, n_lost, failures = len(front_end.keys), len(front_end.lost), front_end.failures
        self._tracking.advance()
        is_key = len(front_end.keys) > n_keys
        if is_key:
            self._graph.extend(self._tracking.motion_to(n_keys))
        is_carried = front_end.failures > failures
        if self._graph.search_on():
            event = Event.LOOP_CLOSED
        elif len(front_end.lost) > n_lost:
            event = Event.LOST
        elif is_carried:
            event = Event.COVERED if front_end.is_blind else Event.CARRIED
        else:
            event = Event.KEY_SCAN if is_key else Event.MATCHED
        return self._update(event, is_key=is_key, is_carried=is_carried)

    def _update(self, event: Event, *, is_key: bool, is_carried: bool = False) -> MapperUpdate:
        T_map_key, covariance = self._graph.newest
        T_key_robot, front_end = self._tracking.T_key_robot, self._tracking.front_end
        if is_carried:
            covariance = compose_covariance(covariance, T_key_robot, front_end.motion.covariance)
        elif not is_key:
            covariance = congruence(adjoint(inverse(T_key_robot)), covariance) + tracked_covariance(front_end.keys[-1])
        return MapperUpdate(
            scan=len(self._tracking) - 1,
            pose=compose(T_map_key, T_key_robot),
            covariance=covariance.copy(),
            event=event,
            is_key_scan=is_key,
        )


def tracked_covariance(key: KeyScan) -> NDArray[np.float64]:
    """(3, 3) what a scan matched behind a key scan may be off by: what match and odometry said on the way to that."""
    if isinstance(key.match, NoMatch):
        return key.motion.covariance
    return np.asarray(inv(inv(key.match.covariance) + inv(key.motion.covariance)))
