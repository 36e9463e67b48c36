"""The first half of a run: a log tracked, its loops closed, key scans matched again where the optimum puts them."""

from dataclasses import replace
from math import sqrt

from frontends.laser_noise import LaserNoise, learn_laser_noise
from frontends.matchers import make_matcher
from frontends.scan import Log
from iceg.config import Config
from iceg.corrections.corrected import Corrected, corrected
from iceg.corrections.corrections import Corrections
from iceg.corrections.forbidden import forbids
from iceg.ice._noise_kernels import RangeNoise
from iceg.ice.matcher import IceMatcher
from iceg.ice.noise import beyond_allowed
from iceg.slam.back_end import solve_track
from iceg.slam.broken_path.path_break import Outcome
from iceg.slam.broken_path.reassigned_scans import reassigned
from iceg.slam.completed_matcher import completed
from iceg.slam.findings import Findings
from iceg.slam.finish import matched_again
from iceg.slam.kept_scans import KeptScans
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.noise_widths import widened
from iceg.slam.odometry.calibration import OdometryCalibration, calibrate_odometry
from iceg.slam.odometry.gyro import learn_gyro
from iceg.slam.odometry.key_motions import key_motions
from iceg.slam.passes import Tracker
from iceg.slam.progress import ProgressCallback
from iceg.slam.recording.companions import without_companions
from iceg.slam.recording.held_readings import with_odometry_between_readings
from iceg.slam.recording.own_body import without_own_body
from iceg.slam.recording.repeated_scans import without_frozen_scans
from iceg.slam.solution import Solution
from iceg.slam.stage_clock import StageClock
from iceg.slam.stages import IN_HOUSE, Stages
from iceg.slam.track import Track
from iceg.slam.tracking.between_keys import smoothed_between_keys
from iceg.slam.tracking.split_half import with_measured_covariance_scale


def find(
    log: Log,
    kept: KeptScans,
    given: Config,
    corrections: Corrections,
    stages: Stages,
    progress: ProgressCallback | None,
    clock: StageClock,
) -> tuple[Findings, MapMatcher]:
    """Track a log and close its loops.

    Args:
        log: the scans that take part.
        kept: which of the recorded scans these are.
        given: the settings.
        corrections: what a person corrects, scans counted as in `log`: they guide the search, and are taken out of what
            it finds.
        stages: what the caller replaces.
        progress: called as the front end proceeds.
        clock: notes what the stages take.

    Returns:
        What was found, and the matcher that found it.
    """
    with clock.stage("front_end"):
        log = without_own_body(log, given.front_end.own_body)
        laser = laser_noise(log, given)
        noise = beyond_allowed(laser)
        config = widened(given, sqrt(noise.typical))
        matcher = matcher_of(config, noise, stages)
        log = with_odometry_between_readings(without_frozen_scans(log), config.front_end.standstill)
        log = without_companions(log, config.front_end.companions)
        followed, tracker = Tracker(matcher=matcher, config=config, progress=progress).guided(log)
    with clock.stage("sweep"):
        followed, sweep = tracker.with_sweep(followed)
        log, track, first = tracker.placed(followed)
    with clock.stage("graph"):
        track = with_measured_covariance_scale(track, matcher, config.front_end.split_half)
        calibration = _recalibrate(track, log, first, config)
        odometry = calibration.apply(log.odometry, config.front_end.calibration.sudden) if log.has_odometry else None
        if odometry is not None:
            track = smoothed_between_keys(track, odometry, config.front_end.smoothing)
        heading, gyro = learn_gyro(track, log, config.front_end)
        motions = key_motions(
            track, log.stamps, odometry, calibration.lasting_noise, config.front_end.calibration, heading
        )
        is_forbidden = forbids(corrections.forbidden, track)
        closer = LoopCloser(matcher, track, config.loops, is_forbidden=is_forbidden, stages=stages)
        solution = solve_track(closer, motions, config.graph, log)
        guided = corrected(solution, corrections, track, matcher, config)
        solution = _with_factors(solution, guided)
        track = _reassigned(track, solution, log, matcher)
    with clock.stage("finish"):
        solution, rounds = matched_again(
            solution,
            track,
            matcher,
            config.loops,
            config.finish,
            kept=guided.consistent,
            is_forbidden=is_forbidden,
            stages=stages,
        )
    findings = Findings(
        log=log,
        kept=kept,
        config=given,
        has_own_stages=stages != IN_HOUSE,
        laser=laser,
        sweep=sweep.record(),
        gyro=gyro,
        track=track,
        calibration=calibration,
        solution=_without_factors(solution, guided),
        rounds=tuple(rounds),
    )
    return findings, matcher


def laser_noise(log: Log, config: Config) -> LaserNoise | None:
    """As the settings say, or else the log; None where neither does."""
    learned = learn_laser_noise(log)
    if config.laser.noise is None:
        return learned
    stated = LaserNoise(constant=config.laser.noise, per_metre=config.laser.noise_per_metre)
    return stated if learned is None else replace(learned, constant=stated.constant, per_metre=stated.per_metre)


def _recalibrate(track: Track, log: Log, first: OdometryCalibration, config: Config) -> OdometryCalibration:
    """The same from all of the log, for the graph's odometry factors."""
    if not (log.has_odometry and config.front_end.calibrate_odometry):
        return first
    return calibrate_odometry(track, log.odometry, config.front_end.calibration)


def _with_factors(solution: Solution, guided: Corrected) -> Solution:
    """The graph with closures by hand that fit it more, at the poses that they lead to."""
    if not guided.consistent:
        return solution
    return replace(solution, factors=[*solution.factors, *guided.consistent], poses=guided.solution.poses)


def _without_factors(solution: Solution, guided: Corrected) -> Solution:
    """The graph without them again, at the poses as they are."""
    return replace(solution, factors=[factor for factor in solution.factors if factor not in guided.consistent])


def _reassigned(track: Track, solution: Solution, log: Log, matcher: MapMatcher) -> Track:
    """The track with the scans around each break on the right side of it."""
    breaks = [
        found
        for found in solution.breaks
        if found.outcome is Outcome.JOINED or (found.outcome is Outcome.APART and found.is_sudden)
    ]
    return reassigned(track, breaks, log, matcher.judge) if breaks else track


def matcher_of(config: Config, noise: RangeNoise, stages: Stages) -> MapMatcher:
    """The matcher of a run, as the pipeline wants it.

    Args:
        config: names one, and has the settings of ICE.
        noise: of the ranges beyond what the settings allow for.
        stages: features and matcher of the caller's own.
    """
    ice = IceMatcher(config.ice, noise=noise, features=stages.features)
    if stages.matcher is not None:
        return completed(stages.matcher, ice)
    return ice if config.matcher == "ice" else completed(make_matcher(config.matcher), ice)
