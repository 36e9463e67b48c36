"""A log tracked with every beam at its own time: what one pass tells of motion and sweep serves the next."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from frontends.scan import Log
from graph.arrays import Floats
from iceg.slam.odometry.calibration import OdometryCalibration
from iceg.slam.recording.intervals import usual_interval
from iceg.slam.sweep.deskew import deskewed
from iceg.slam.sweep.estimate import SweepEstimate, learn_sweep
from iceg.slam.sweep.motion import MotionWithin, motion_within
from iceg.slam.sweep_config import SweepConfig
from iceg.slam.track import Track

Followed = tuple[Log, Track, OdometryCalibration]
"""A log as it was tracked, its track and the calibration on the way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepFinding:
    """What a run knows of the sweep of its laser.

    Attributes:
        source: where from; "nothing" where neither the log nor its scans say.
        estimate: the sweep in intervals.
        interval: usual time from scan to scan [s], None where the log has no times.
        displacement: by how much the sweep moves returns, root mean square [m].
        passes: how often the log was tracked with beams moved by the motion within the sweep.
    """

    source: Literal["log", "scans", "nothing"]
    estimate: SweepEstimate | None = None
    interval: float | None = None
    displacement: float = 0.0
    passes: int = 0

    def record(self) -> dict[str, Any]:
        """For `summary.json`: seconds where the log has times, else intervals from scan to scan."""
        if self.estimate is None:
            return {"source": self.source, "applied": False}
        unit, name = (1.0, "intervals") if self.interval is None else (self.interval, "s")
        return {
            "source": self.source,
            "applied": self.passes > 0,
            f"duration_{name}": round(abs(self.estimate.share) * unit, 5),
            f"std_{name}": round(self.estimate.deviation * unit, 5),
            "direction": "clockwise" if self.estimate.share < 0.0 else "counter-clockwise",
            "displacement_m": round(self.displacement, 4),
            "passes": self.passes,
        }


def track_swept(
    followed: Followed, follow: Callable[[Log], Followed], config: SweepConfig
) -> tuple[Followed, SweepFinding]:
    """Track a log again with its beams moved by the motion within each sweep, as long as that moves any.

    Args:
        followed: the log, and what the first pass made of it.
        follow: tracks a log.
        config: what it takes.

    Returns:
        The same of the last pass, its log with all beams of a scan seen at once; and what is known of the sweep.
    """
    log = followed[0]
    interval = usual_interval(log.stamps)
    finding, moved = SweepFinding(source="nothing"), np.zeros((len(log), 3))
    for passes in range(config.max_passes + 1):
        track = followed[1]
        motion = motion_within(track.T_track_scans, log.stamps, (*track.lost, *track.breaks))
        source, estimate = _sweep(log, track, motion, interval, config)
        if estimate is None:
            break
        finding = SweepFinding(
            source=source,
            estimate=estimate,
            interval=interval,
            displacement=_displacement(log, estimate.share * motion.velocity),
            passes=passes,
        )
        further = estimate.share * motion.velocity - moved
        if (
            passes == config.max_passes
            or not estimate.is_significant(config.false_alarm)
            or _displacement(log, further) < config.min_displacement
        ):
            break
        moved = moved + further
        followed = follow(deskewed(log, motion, estimate.share))
    return followed, finding


def _sweep(
    log: Log, track: Track, motion: MotionWithin, interval: float | None, config: SweepConfig
) -> tuple[Literal["log", "scans"], SweepEstimate | None]:
    """What the log says, else what its scans tell."""
    if log.sweep is not None and interval is not None:
        return "log", SweepEstimate(share=log.sweep / interval, deviation=0.0)
    per_interval = _displacement(log, motion.velocity)
    least = config.min_displacement / per_interval if per_interval > 0.0 else np.inf
    return "scans", learn_sweep(log, track.T_track_scans, motion, config, least)


def _displacement(log: Log, motion: Floats) -> float:
    """Root mean square of what (n_scans, 3) motions within a sweep move a return at the usual range by [m]."""
    returns = log.ranges[np.isfinite(log.ranges)]
    arm = float(np.median(returns)) if len(returns) else 0.0
    along2 = motion[:, 0] ** 2 + motion[:, 1] ** 2 + (arm * motion[:, 2]) ** 2
    return float(np.sqrt(along2.mean() / 12.0))  # beams are spread evenly over the sweep
