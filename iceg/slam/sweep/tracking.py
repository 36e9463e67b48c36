"""A log tracked with every beam at its own time: what the first pass tells of motion and sweep serves a second one."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from frontends.scan import Log
from iceg.slam.odometry.calibration import OdometryCalibration
from iceg.slam.sweep.deskew import deskewed
from iceg.slam.sweep.estimate import SweepEstimate, learn_sweep
from iceg.slam.sweep.motion import MotionWithin, motion_within, usual_interval
from iceg.slam.tracking.track import Track

_PASSES = 2
"""Passes over scans that are straightened; a third moves nothing any more."""

Followed = tuple[Log, Track, OdometryCalibration]
"""A log as it was tracked, its track and the calibration on the way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepFinding:
    """What a run knows of the sweep of its laser.

    Attributes:
        source: where from; "nothing" where neither the log nor its scans say.
        estimate: the sweep in intervals.
        interval: usual time from scan to scan [s], None where the log has no times.
        is_applied: whether the beams were moved.
    """

    source: Literal["log", "scans", "nothing"]
    estimate: SweepEstimate | None = None
    interval: float | None = None
    is_applied: bool = False

    def record(self) -> dict[str, Any]:
        """For `summary.json`: seconds where the log has times."""
        if self.estimate is None:
            return {"source": self.source, "applied": False}
        unit = self.interval or 1.0
        return {
            "source": self.source,
            "applied": self.is_applied,
            "duration_s" if self.interval else "duration_intervals": round(abs(self.estimate.share) * unit, 5),
            "std_s" if self.interval else "std_intervals": round(self.estimate.deviation * unit, 5),
            "direction": "clockwise" if self.estimate.share < 0.0 else "counter-clockwise",
        }


def track_swept(followed: Followed, follow: Callable[[Log], Followed]) -> tuple[Followed, SweepFinding]:
    """Track a log again with its beams moved by the motion within each sweep, where there is one.

    Args:
        followed: the log, and what the first pass made of it.
        follow: tracks a log.

    Returns:
        The same of the last pass, its log with all beams of a scan seen at once; and what is known of the sweep.
    """
    log = followed[0]
    finding = _finding(log, followed[1])
    if not finding.is_applied:
        return followed, finding
    for _ in range(_PASSES):
        motion = _motion(log, followed[1])
        finding = _finding(log, followed[1])
        if finding.estimate is None:
            break
        followed = follow(deskewed(log, motion, finding.estimate.share))
    return followed, finding


def _finding(log: Log, track: Track) -> SweepFinding:
    interval = usual_interval(log.stamps)
    if log.sweep is not None and interval is not None:
        stated = SweepEstimate(share=log.sweep / interval, deviation=0.0)
        return SweepFinding(source="log", estimate=stated, interval=interval, is_applied=stated.share != 0.0)
    learned = learn_sweep(log, _trajectory(track), _motion(log, track))
    if learned is None:
        return SweepFinding(source="nothing")
    return SweepFinding(source="scans", estimate=learned, interval=interval, is_applied=learned.is_significant)


def _motion(log: Log, track: Track) -> MotionWithin:
    return motion_within(_trajectory(track), log.stamps, (*track.lost, *track.breaks))


def _trajectory(track: Track) -> np.ndarray:
    return track.trajectory(np.array([key.T_track_robot for key in track.keys]))
