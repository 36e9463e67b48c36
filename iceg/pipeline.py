"""The whole job: a log in; trajectory, graph, feature map and occupancy grid out."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from frontends.laser_noise import LaserNoise
from frontends.scan import Log
from graph.batch import marginal_covariances
from graph.pose_graph import PoseGraph
from iceg.beside import InThread
from iceg.config import Config
from iceg.corrections.corrected import corrected
from iceg.corrections.corrections import Corrections, CorrectionsError
from iceg.corrections.cut_findings import cut_findings
from iceg.corrections.manual_closures import ManualClosure
from iceg.corrections.map_frame import in_frame
from iceg.finding import find, matcher_of
from iceg.ice.matcher import REMEMBERED
from iceg.ice.noise import beyond_allowed
from iceg.maps.feature_map import Landmarks, build_feature_map
from iceg.maps.grid import OccupancyGrid, render_grid_that_fits
from iceg.memory import release_freed_memory
from iceg.run_result.joint_covariance import JointCovariance
from iceg.run_result.path_uncertainty import least_known
from iceg.run_result.run_summary import LaserSummary, RunCounts, RunSummary
from iceg.run_result.slam_result import SlamResult
from iceg.run_result.summary import run_warnings, summarise
from iceg.slam.agreement import Tolerance
from iceg.slam.broken_path.displacement import displaced_covariances, displacements
from iceg.slam.closures.closure import Closure, best_rival
from iceg.slam.findings import Findings
from iceg.slam.finish import Finished, refined
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.noise_widths import widened
from iceg.slam.progress import ProgressCallback, StageProgress
from iceg.slam.solution import Solution
from iceg.slam.stage_clock import StageClock
from iceg.slam.stages import IN_HOUSE, Stages
from iceg.slam.track import Track
from iceg.slam.tracking.laser_place import place_warning


def run(
    log: Log,
    config: Config | None = None,
    progress: ProgressCallback | None = None,
    *,
    stages: Stages | None = None,
    closures: Sequence[ManualClosure] = (),
    corrections: Corrections | None = None,
) -> SlamResult:
    """Estimate the trajectory and the maps of a log.

    Args:
        log: the log.
        config: settings; the defaults when left out.
        progress: called as scans are matched, and when a stage begins.
        stages: those that are replaced by functions of one's own.
        closures: loops closed by hand, besides those of the corrections.
        corrections: what a person corrects, scans counted as in `log`.

    Returns:
        Everything that was found.

    Raises:
        IcegError: a correction that does not fit the log, or a stage that returns what is of no use.
    """
    stages = stages or IN_HOUSE
    asked = (corrections or Corrections()).with_closures(closures)
    kept = asked.check(len(log))
    told = StageProgress(progress)
    clock = StageClock(told.begin)
    findings, matcher = find(kept.of(log), kept, config or Config(), asked.counted_in(kept), stages, told, clock)
    return conclude(findings, asked, matcher, clock, stages)


def resolve(findings: Findings, corrections: Corrections | None = None) -> SlamResult:
    """Solve, refine and render what a run has found, corrected otherwise; nothing is matched anew.

    Closures by hand that only name scans are matched.

    Args:
        findings: of a run, as in its result, or read back from its folder.
        corrections: all of them: those that the run was given before count no more, but for what it cut where these cut
            nothing. Scans are counted as recorded.

    Returns:
        The same as a run.

    Raises:
        IcegError: a correction that does not fit the log, or the run was made with a stage of the caller's own.
    """
    if findings.has_own_stages:
        raise CorrectionsError(
            "the run was made with a stage of the caller's own, such as a matcher, expected those of iceg: run again"
        )
    asked = corrections or Corrections()
    kept = asked.check(findings.kept.recorded, findings.kept)
    left = findings if kept == findings.kept else cut_findings(findings, kept, asked.cut.where)
    return replace(conclude(left, asked, None, StageClock()), findings=findings)


def conclude(
    findings: Findings,
    corrections: Corrections,
    matcher: MapMatcher | None,
    clock: StageClock,
    stages: Stages = IN_HOUSE,
) -> SlamResult:
    """Correct, refine and render what was found.

    Args:
        findings: of tracking and loop closing.
        corrections: all of them, scans counted as recorded.
        matcher: that found them; None for the one that the settings name.
        clock: notes what the stages take.
        stages: grid of the caller's own.
    """
    log, track, given = findings.log, findings.track, findings.config
    noise = beyond_allowed(findings.laser)
    config = widened(given, sqrt(noise.typical))
    matcher = matcher or matcher_of(config, noise, stages)
    own = corrections.counted_in(findings.kept)
    with clock.stage("finish"):
        after = corrected(findings.solution, own, track, matcher, config)
        _release(matcher, track)
        finished = refined(
            after.solution,
            findings.rounds,
            track,
            matcher,
            config.finish,
            scan_of=log.scan,
            noise=noise,
            distrusted=after.distrusted,
        )
    with clock.stage("covariances"):
        solution, walls = in_frame(own.frame, finished.solution, finished.walls, track, config.ice.segments)
        joint = _joint_covariance(finished, solution)
        _release(matcher, track)
    trajectory = track.trajectory(solution.poses)
    with clock.stage("feature_map"):
        drawing = InThread(partial(_timed_grid, log, trajectory, config, stages))
        landmarks = landmarks_of(track, solution.poses, matcher, config)
    clock.begin("grid")
    grid, grid_warning, drawn = drawing.result()
    clock.add(drawn)
    _release(matcher, track)
    worst = least_known(track.key_scans, joint.marginals)
    told = run_warnings(track, solution, worst, config.finish.uncertain, grid_warning, findings.gyro)
    misplaced = place_warning(log, findings.calibration, config.front_end.calibration)
    warnings = after.warnings + finished.warnings + told + (() if misplaced is None else (misplaced,))
    counts = summarise(log, track, solution, findings.calibration, finished.rounds, worst, warnings)
    return SlamResult(
        log=log,
        config=given,
        trajectory=trajectory,
        key_scans=track.key_scans,
        key_poses=solution.poses,
        covariances=joint.marginals,
        joint=joint,
        graph=PoseGraph.from_factors(solution.factors, solution.poses, config.graph),
        landmarks=landmarks,
        grid=grid,
        walls=walls,
        closures=[*_closures(track, solution, config.loops.verification.place), *after.by_hand],
        run_warnings=warnings,
        summary=_summary(counts, findings, corrections, clock),
        findings=findings,
    )


def _summary(counts: RunCounts, findings: Findings, corrections: Corrections, clock: StageClock) -> RunSummary:
    """What `summary.json` holds: the counts, and what was learned, corrected and spent."""
    summary: RunSummary = {
        **counts,
        "laser": _described(findings.laser),
        "sweep": findings.sweep,
        "seconds": clock.seconds,
        "cpu_seconds": clock.cpu_seconds,
    }
    if not findings.log.is_mount_known:
        x, y, heading = findings.log.geometry.T_robot_laser.tolist()
        summary["mount"] = {"x_m": x, "y_m": y, "heading_rad": heading}
    if findings.gyro is not None:
        summary["gyro"] = findings.gyro.record()
    if record := corrections.record():
        summary["corrections"] = record
    if not findings.kept.is_all:
        summary["cut"] = findings.kept.record()
    return summary


def _joint_covariance(finished: Finished, solution: Solution) -> JointCovariance:
    """Of the key poses: as the walls tell, else the graph."""
    factors, known = solution.factors, finished.covariances
    if known is None:
        known = marginal_covariances(factors, solution.poses)
    displaced = displacements(solution.breaks, solution.poses)
    return JointCovariance(
        poses=solution.poses,
        marginals=known + displaced_covariances(displaced, len(known)),
        information=finished.information,
        factors=factors,
        displacements=displaced,
    )


def landmarks_of(track: Track, key_poses: NDArray[np.float64], matcher: MapMatcher, config: Config) -> Landmarks:
    """The feature map of a track whose key poses are (k, 3)."""
    features = (matcher.judge.observe(key.scan).features.unpack() for key in track.keys)
    feature_map = build_feature_map(key_poses, features, (key.scan for key in track.keys), config.feature_map)
    return feature_map.record()


def _release(matcher: MapMatcher, track: Track) -> None:
    """Give back the memory that the stages of a long run took, before one that needs much itself.

    Of a short run all that was extracted is kept, and serves the next stage; of a long one too little is left to serve
    whoever asks for the scans from the first one on.
    """
    if len(track.keys) > REMEMBERED:
        matcher.judge.forget()
        release_freed_memory()


def _timed_grid(
    log: Log, trajectory: NDArray[np.float64], config: Config, stages: Stages
) -> tuple[OccupancyGrid, str | None, StageClock]:
    """`grid_of` with a clock of its own: it is drawn in a thread."""
    clock = StageClock()
    with clock.stage("grid"):
        return *grid_of(log, trajectory, config, stages), clock


def grid_of(
    log: Log, trajectory: NDArray[np.float64], config: Config, stages: Stages
) -> tuple[OccupancyGrid, str | None]:
    """The occupancy grid along a trajectory, (n, 3), and what it warns of."""
    if stages.grid is not None:
        return stages.grid(trajectory, log.ranges, log.geometry, config.grid), None
    return render_grid_that_fits(trajectory, log.ranges, log.geometry, config.grid)


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


def _closures(track: Track, solution: Solution, one_place: Tolerance) -> list[Closure]:
    return [
        Closure(
            scan_i=track.keys[attempt.key_old].index,
            scan_j=track.keys[attempt.key_new].index,
            T_i_j=np.full(3, np.nan) if attempt.match is None else attempt.match.T_ref_cur,
            score=0.0 if attempt.match is None else attempt.match.score,
            inliers=0 if attempt.match is None else attempt.match.inliers,
            overlap=0.0 if attempt.match is None else attempt.match.overlap,
            verdict=attempt.verdict,
            reason=attempt.reason,
            off_path=attempt.off_path,
            rival=best_rival(attempt, one_place),
        )
        for attempt in solution.attempts
    ]
