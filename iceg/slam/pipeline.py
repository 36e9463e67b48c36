"""The whole job: a log in; trajectory, graph, feature map and occupancy grid out."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from frontends.laser_noise import LaserNoise, learn_laser_noise
from frontends.matcher import Matcher
from frontends.matchers import make_matcher
from frontends.scan import Log
from graph.batch import marginal_covariances
from graph.factors import Factor
from graph.pose_graph import PoseGraph
from iceg.config import Config
from iceg.ice._point_kernels import RangeNoise
from iceg.ice.features import extract_features
from iceg.ice.matcher import IceMatcher
from iceg.ice.noise import beyond_allowed
from iceg.maps.feature_map import Landmarks, build_feature_map
from iceg.maps.grid import OccupancyGrid, render_grid_that_fits
from iceg.result_tables import RunTables, TableName
from iceg.slam.back_end import Solution, solve_track
from iceg.slam.closures.closure import Closure
from iceg.slam.distance import Distance, Sighting, measured_distance, sighting_at
from iceg.slam.final_factors import FinalFactors
from iceg.slam.finish import Finished, finish
from iceg.slam.joint.wall_pieces import WallPieces
from iceg.slam.joint_covariance import JointCovariance
from iceg.slam.manual_closures import (
    ManualClosure,
    add_by_hand,
    check_manual_closures,
    manual_factors,
    manual_records,
)
from iceg.slam.noise_widths import widened
from iceg.slam.odometry.calibration import OdometryCalibration, calibrate_odometry
from iceg.slam.odometry.constant_velocity import constant_velocity
from iceg.slam.odometry.gyro import learn_gyro
from iceg.slam.odometry.heading_odometry import HeadingOdometry
from iceg.slam.passes import track_with_gyro, track_with_sweep
from iceg.slam.path_uncertainty import least_known
from iceg.slam.progress import ProgressCallback
from iceg.slam.recording.repeated_scans import without_frozen_scans
from iceg.slam.recording.standstill import with_odometry_between_readings
from iceg.slam.run_summary import LaserSummary, RunSummary
from iceg.slam.run_warning import RunWarning
from iceg.slam.summary import run_warnings, summarise
from iceg.slam.track import Track
from iceg.slam.tracking.broken_track import retied
from iceg.slam.tracking.open_ground import is_open_ground
from iceg.slam.tracking.split_half import with_measured_doubt

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamResult:
    """What a run found.

    Attributes:
        log: the log.
        config: the settings.
        trajectory: (n_scans, 3) T_map_robot of every scan, in file order.
        key_scans: (k,) which scans are key scans.
        key_poses: (k, 3) their T_map_robot.
        covariances: (k, 3, 3) their marginal covariances, tangent space at each.
        joint: how the errors of the key poses hang together.
        graph: the factors as they were measured. The key poses rest on the walls that scans share, too, and are not
            quite the optimum of the factors alone.
        landmarks: the feature map, expired landmarks included.
        grid: the occupancy grid.
        walls: short straight pieces of wall, none where poses and map were not refined together.
        closures: every loop closure tried.
        warnings: what is doubtful about it, besides what is about the log.
        summary: counts, warnings, seconds per stage and calibration.
    """

    log: Log
    config: Config
    trajectory: NDArray[np.float64]
    key_scans: NDArray[np.int64]
    key_poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    joint: JointCovariance
    graph: PoseGraph
    landmarks: Landmarks
    grid: OccupancyGrid
    walls: WallPieces
    closures: list[Closure]
    warnings: tuple[RunWarning, ...]
    summary: RunSummary

    def __repr__(self) -> str:
        accepted = sum(closure.verdict == "accepted" for closure in self.closures)
        return (
            f"SlamResult({self.log.path.name}: {len(self.trajectory)} scans, {len(self.key_scans)} key poses, "
            f"{len(self.graph.factors)} factors, {accepted} of {len(self.closures)} closures accepted, "
            f"{len(self.landmarks.settled())} landmarks, {len(self.summary['warnings'])} warnings)"
        )

    def sighting(self, x: float, y: float) -> Sighting:
        """The place (x, y) of the map [m], as the key scan saw it that saw it from closest.

        Within 10 cm of a wall that is the wall: the nearest end of a beam of that scan.

        Raises:
            DistanceError: no key scan looked there.
        """
        return sighting_at(np.array([x, y]), self.log, self.key_scans, self.key_poses)

    def distance(self, a: Sighting | tuple[float, float], b: Sighting | tuple[float, float]) -> Distance:
        """How far two points are apart, and how well that is known.

        The standard deviation is that of the joint covariance of the two poses that saw the points, and of the laser
        where a point is the end of a beam.

        Args:
            a: a point that a scan saw, or x, y in the map [m], for which see `sighting`.
            b: the other.

        Raises:
            DistanceError: no key scan looked there, or a scan that the log does not have.
        """
        a, b = (point if isinstance(point, Sighting) else self.sighting(*point) for point in (a, b))
        return measured_distance(a, b, self.trajectory, self.key_scans, self.joint, self.log, self.summary["laser"])

    def _repr_html_(self) -> str:
        """A small map and the figures, for notebooks."""
        from iceg.show.result_html import result_html

        return result_html(self)

    def tables(self) -> RunTables:
        """The result as tables of plain columns, for pandas, CSV and Parquet."""
        tracking = (self.config.front_end.tracking_distance, self.config.front_end.tracking_angle)
        return RunTables(
            stamps=self.log.stamps,
            trajectory=self.trajectory,
            key_scans=self.key_scans,
            key_poses=self.key_poses,
            covariances=self.covariances,
            tracking=tracking,
            closures=self.closures,
            landmarks=self.landmarks,
            factors=self.graph.factors,
        )

    def to_frame(self, name: TableName) -> "pd.DataFrame":
        """One table of the result for pandas.

        Args:
            name: "trajectory", "key_poses", "closures", "landmarks" or "factors".

        Raises:
            TableExportError: there is no such table, or no pandas.
        """
        return self.tables().frame(name)

    def scan_covariances(self) -> NDArray[np.float64]:
        """(n_scans, 3, 3) covariance of every scan's pose, see `iceg.slam.scan_covariances`."""
        return self.tables().scan_covariances()


def run(
    log: Log,
    config: Config | None = None,
    progress: ProgressCallback | None = None,
    *,
    matcher: Matcher | None = None,
    closures: Sequence[ManualClosure] = (),
) -> SlamResult:
    """Estimate the trajectory and the maps of a log.

    Args:
        log: the log.
        config: settings; the defaults when left out.
        progress: called as the front end proceeds.
        matcher: any scan matcher; the one that the settings name when left out.
        closures: loops closed by hand.

    Returns:
        Everything that was found.
    """
    given = config or Config()
    check_manual_closures(closures, len(log))
    clock = _StageClock()
    with clock.stage("front_end"):
        laser = _laser_noise(log, given)
        noise = beyond_allowed(laser)
        config = widened(given, sqrt(noise.typical))
        matcher = matcher or _matcher(log, config, noise)
        log = with_odometry_between_readings(without_frozen_scans(log))
        (log, track, first), heading = track_with_gyro(log, matcher, config, progress)
    with clock.stage("sweep"):
        (log, track, first), sweep = track_with_sweep((log, track, first), matcher, config, progress, heading)
    with clock.stage("graph"):
        track = with_measured_doubt(track, matcher, config.front_end.split_scans)
        calibration = _recalibrate(track, log, first, config)
        by_hand = manual_factors(closures, track)
        heading, gyro = learn_gyro(track, log) if config.front_end.gyro else (None, None)
        solution = _solve(track, log, matcher, calibration, heading, config)
        solution = add_by_hand(solution, by_hand, config.graph)
        track = _retied(track, solution, log, matcher)
    with clock.stage("finish"):
        solution, finished = _finish(solution, track, log, matcher, config, noise, by_hand)
    with clock.stage("covariances"):
        joint = _joint_covariance(finished, solution)
    trajectory = track.trajectory(solution.poses)
    with clock.stage("feature_map"):
        landmarks = _landmarks(track, solution.poses, matcher, config)
    with clock.stage("grid"):
        grid, doubt = render_grid_that_fits(trajectory, log.ranges, log.geometry, config.grid)
    key_scans = np.array([key.index for key in track.keys], dtype=np.int64)
    worst = least_known(key_scans, joint.marginals)
    warnings = run_warnings(track, solution, finished.rounds, worst, doubt, gyro)
    summary: RunSummary = {
        **summarise(log, track, solution, calibration, finished.rounds, worst, warnings),
        "laser": _described(laser),
        "sweep": sweep.record(),
        "seconds": clock.seconds,
        "cpu_seconds": clock.cpu_seconds,
    }
    if gyro is not None:
        summary["gyro"] = gyro.record()
    return SlamResult(
        log=log,
        config=given,
        trajectory=trajectory,
        key_scans=key_scans,
        key_poses=solution.poses,
        covariances=joint.marginals,
        joint=joint,
        graph=solution.graph,
        landmarks=landmarks,
        grid=grid,
        walls=finished.walls,
        closures=_closures(track, solution) + manual_records(closures, track),
        warnings=warnings,
        summary=summary,
    )


class _StageClock:
    """Seconds spent in each stage: on the wall, and of the processor."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        started, cpu_started = time.perf_counter(), time.process_time()
        yield
        self.seconds[name] = round(time.perf_counter() - started, 4)
        self.cpu_seconds[name] = round(time.process_time() - cpu_started, 4)


def _laser_noise(log: Log, config: Config) -> LaserNoise | None:
    """As the settings say, or else the log; None where neither does."""
    learned = learn_laser_noise(log)
    if config.laser.noise is None:
        return learned
    stated = LaserNoise(constant=config.laser.noise, per_metre=config.laser.noise_per_metre)
    return stated if learned is None else replace(learned, constant=stated.constant, per_metre=stated.per_metre)


def _described(laser: LaserNoise | None) -> LaserSummary | None:
    """The noise of the laser under the names of `summary.json`, None where too few beams meet walls."""
    if laser is None:
        return None
    return {
        "noise_m": round(laser.constant, 5),
        "noise_per_metre": round(laser.per_metre, 6),
        "typical_range_m": round(laser.typical_range, 3),
        "outlier_share": round(laser.outlier_share, 4),
        "no_return_share": round(laser.no_return_share, 4),
        "step_m": round(laser.step, 6),
    }


def _matcher(log: Log, config: Config, noise: RangeNoise) -> Matcher:
    if config.matcher != "ice":
        return make_matcher(config.matcher)
    return IceMatcher(config.ice, open_ground=is_open_ground(log), noise=noise)


def _recalibrate(track: Track, log: Log, first: OdometryCalibration, config: Config) -> OdometryCalibration:
    """The same from all of the log, for the graph's odometry factors."""
    if not (log.has_odometry and config.front_end.calibrate_odometry):
        return first
    return calibrate_odometry(track, log.odometry)


def _solve(
    track: Track,
    log: Log,
    matcher: Matcher,
    calibration: OdometryCalibration,
    heading: HeadingOdometry | None,
    config: Config,
) -> Solution:
    if log.has_odometry:
        odometry, noise = calibration.apply(log.odometry), calibration.lasting_noise
        return solve_track(track, odometry, noise, matcher, config.graph, config.loops)
    poses, noise = constant_velocity(track, heading) or (None, calibration.lasting_noise)
    return solve_track(track, poses, noise, matcher, config.graph, config.loops)


def _retied(track: Track, solution: Solution, log: Log, matcher: Matcher) -> Track:
    """The track with the scans around each break on the right side of it."""
    joined = [found.key for found in solution.breaks if found.outcome == "joined"]
    if not joined:
        return track
    return retied(track, joined, log, matcher if isinstance(matcher, IceMatcher) else IceMatcher())


def _finish(
    solution: Solution,
    track: Track,
    log: Log,
    matcher: Matcher,
    config: Config,
    noise: RangeNoise,
    by_hand: list[Factor],
) -> tuple[Solution, Finished]:
    """The solution after the offline finish, and what that did; one with no rounds where it is switched off.

    Its closures join the record; those it dropped stay in it with the reason.
    """
    if config.finish.enabled and len(track.keys) > 1:
        finished = finish(
            solution, track, matcher, config.loops, config.finish, kept=by_hand, scan_of=log.scan, noise=noise
        )
    else:
        factors = FinalFactors.of(solution.graph.factors, solution.breaks, track)
        finished = Finished(poses=solution.poses, factors=factors, attempts=solution.attempts, rounds=[])
        if factors.are_all_believed:
            return solution, finished
    graph = PoseGraph.from_factors(finished.factors.measured, finished.poses, config.graph)
    return replace(solution, graph=graph, poses=finished.poses, attempts=finished.attempts), finished


def _joint_covariance(finished: Finished, solution: Solution) -> JointCovariance:
    """Of the key poses: as the walls tell, else the graph."""
    factors, known = solution.graph.factors, finished.covariances
    if known is None:
        known = marginal_covariances(factors, solution.poses)
    return JointCovariance(poses=solution.poses, marginals=known, information=finished.information, factors=factors)


def _landmarks(track: Track, key_poses: NDArray[np.float64], matcher: Matcher, config: Config) -> Landmarks:
    if isinstance(matcher, IceMatcher):
        features = (matcher.observe(key.scan).features.unpack() for key in track.keys)
    else:
        features = (extract_features(key.scan, config.ice.features, config.ice.segments) for key in track.keys)
    feature_map = build_feature_map(key_poses, features, (key.scan for key in track.keys), config.feature_map)
    return feature_map.record()


def _closures(track: Track, solution: Solution) -> list[Closure]:
    return [
        Closure(
            scan_i=track.keys[attempt.key_old].index,
            scan_j=track.keys[attempt.key_new].index,
            T_i_j=np.full(3, np.nan) if attempt.match is None else attempt.match.T_ref_cur,
            score=0.0 if attempt.match is None else attempt.match.score,
            inliers=0 if attempt.match is None else attempt.match.inliers,
            overlap=0.0 if attempt.match is None else attempt.match.overlap,
            verdict="accepted" if attempt.accepted else "removed" if attempt.removed else "rejected",
            reason=attempt.reason,
        )
        for attempt in solution.attempts
    ]
