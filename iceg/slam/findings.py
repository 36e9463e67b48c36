"""What a run finds in a log before it concludes: all that matching tells, so that concluding anew needs no matching."""

from dataclasses import dataclass
from typing import Any

from frontends.laser_noise import LaserNoise
from frontends.scan import Log
from graph.short_repr import short_repr
from iceg.config import Config
from iceg.slam.finish import Round
from iceg.slam.kept_scans import KeptScans
from iceg.slam.odometry.calibration import OdometryCalibration
from iceg.slam.odometry.gyro import GyroFinding
from iceg.slam.solution import Solution
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What tracking, loop closing and matching again have found, nothing corrected by hand among it.

    Attributes:
        log: as it was tracked: odometry between readings filled in, beams moved by the motion within a sweep.
        kept: which scans of the recorded log these are.
        config: the settings that were given.
        has_own_stages: whether the caller brought stages of their own, such as a matcher, which no settings name.
        laser: its noise; None where too few beams meet walls.
        sweep: what is known of the sweep of the laser, under the names of `summary.json`.
        gyro: what the matches say of the log's gyro; None where they were not asked.
        track: key scans, and every other scan tied to one.
        calibration: of the odometry.
        solution: the graph, its optimum, and the record of closures tried.
        rounds: what the finish did until here.
    """

    log: Log
    kept: KeptScans
    config: Config
    has_own_stages: bool
    laser: LaserNoise | None
    sweep: dict[str, Any]
    gyro: GyroFinding | None
    track: Track
    calibration: OdometryCalibration
    solution: Solution
    rounds: tuple[Round, ...] = ()

    __repr__ = short_repr
