"""What a run tells of itself: counts, warnings, what became of each break, and the calibration of the odometry."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import cast

from frontends.scan import Log
from graph.measurement import RelativePose
from iceg.run_result.path_uncertainty import LeastKnown
from iceg.run_result.run_summary import RoundSummary, RunCounts
from iceg.slam.broken_path.path_break import describe_break
from iceg.slam.broken_path.place_votes import describe_vote
from iceg.slam.finish import Round
from iceg.slam.odometry.calibration import OdometryCalibration
from iceg.slam.odometry.gyro import GyroFinding
from iceg.slam.recording.standstill import describe_dead
from iceg.slam.run_warning import RunWarning
from iceg.slam.solution import Solution
from iceg.slam.track import Track


def summarise(
    log: Log,
    track: Track,
    solution: Solution,
    calibration: OdometryCalibration,
    rounds: list[Round],
    worst: LeastKnown,
    warnings: Sequence[RunWarning],
) -> RunCounts:
    """Sum up a run, for `summary.json`.

    Args:
        log: the log.
        track: what the front end made of it.
        solution: the graph at the end, its record of closures and breaks.
        calibration: of the odometry.
        rounds: what the offline finish did.
        worst: the key pose known least.
        warnings: what the run warns of besides what the log does.

    Returns:
        Counts, warnings and calibration under the names of `summary.json`; lengths in metres, angles in radians.
    """
    factors = solution.factors
    matches = [key.match for key in track.keys if isinstance(key.match, RelativePose)]
    kinds = ("prior", "odometry", "ice", "closure")
    return {
        "log": log.path.name,
        "scans": len(log),
        "skipped_lines": log.skipped_lines,
        "chosen": dict(log.choices),
        "warnings": [*log.warnings, *(warning.sentence for warning in warnings)],
        "key_poses": len(track.keys),
        "scans_carried_by_odometry": track.failures,
        "lost_at_scans": track.lost,
        "breaks": [
            {
                "scan": track.keys[found.key].index,
                "outcome": found.outcome.value,
                "moved_m": round(found.moved, 3),
                "probability_displaced": round(found.probability, 3),
            }
            for found in solution.breaks
        ],
        "odometry_jumps": len(solution.odometry_jumps),
        "odometry_breaks_at_scans": track.breaks,
        "match_covariance_scale": round(track.match_covariance_scale, 3),
        "weak_matches": sum(not match.is_fully_observed for match in matches),
        "factors": {kind: sum(1 for factor in factors if factor.kind == kind) for kind in kinds},
        "closures": {
            "tried": len(solution.attempts),
            "accepted": sum(1 for attempt in solution.attempts if attempt.accepted),
        },
        "finish": [cast("RoundSummary", asdict(done)) for done in rounds],
        "odometry": {
            "translation_scale": calibration.translation_scale,
            "heading_scale": calibration.heading_scale,
            "heading_per_metre_rad": calibration.heading_per_metre,
            "heading_shift_scans": calibration.heading_shift,
            "translation_shift_scans": calibration.translation_shift,
            "T_odometry_laser": calibration.T_odometry_laser,
        },
        "least_known": {"scan": worst.scan, "position_std_m": round(worst.deviation, 4)},
    }


def run_warnings(
    track: Track,
    solution: Solution,
    worst: LeastKnown,
    uncertain: float,
    grid_warning: str | None,
    gyro: GyroFinding | None,
) -> tuple[RunWarning, ...]:
    """What the run itself warns of.

    Args:
        track: what the front end made of the log.
        solution: the graph at the end, its record of breaks.
        worst: the key pose known least …
        uncertain: … and the standard deviation from which on that is worth a warning [m].
        grid_warning: what the occupancy grid warns of, None for nothing.
        gyro: what the matches say of the log's gyro, None where they were not asked.
    """
    warnings = [] if grid_warning is None else [RunWarning(kind="coarse grid", sentence=grid_warning)]
    sentence = worst.warning(uncertain)
    if sentence is not None:
        warnings.append(RunWarning(kind="uncertain path", sentence=sentence, scan=worst.scan))
    unused = None if gyro is None else gyro.warning()
    if unused is not None:
        warnings.append(unused)
    warnings += [describe_dead(*interval) for interval in track.dead]
    warnings += [describe_break(found, track) for found in solution.breaks]
    warnings += [describe_vote(vote, track) for vote in solution.ambiguous]
    return tuple(warnings)
