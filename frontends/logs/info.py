"""What is in a log, for a person who has not seen it yet."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.laser_noise import LaserNoise, learn_laser_noise
from frontends.scan import Log
from graph.se2 import wrap_angle

_GAP_PERIODS, _SHORTEST_GAP = 5.0, 1.0
"""Two stamps that lie so many usual periods and so long [s] apart have a gap between them."""
_TOLD_GAPS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class LogInfo:
    """A log in figures.

    Attributes:
        path: where it was read from.
        scans: number of scans.
        beams: beams of a scan.
        field_of_view: from the first to the last beam [rad].
        resolution: between two beams [rad].
        T_robot_laser: the laser's x [m], y [m] and heading [rad] on the robot.
        range_min: shortest reading taken as a return [m].
        range_max: longest reading taken as a return [m].
        range_quartiles: shortest, lower quartile, median, upper quartile and longest return [m]; NaN without returns.
        no_return_share: share of the beams without usable return, in [0, 1].
        empty_scans: scans without any return.
        duration: between the earliest and the latest stamp [s].
        stamps_stepping_back: how often a stamp is earlier than the one before.
        gaps: beginning after the first stamp and length [s] of each gap in the stamps, longest first.
        has_odometry: whether there is odometry that says something.
        path_length: of the robot by odometry [m].
        turned_angle: sum of all turns by odometry [rad].
        skipped_lines: malformed lines passed over.
        message_counts: messages in the file, by kind.
        warnings: what the reader noticed.
        choices: what the reader chose, and why, by its subject.
        has_truth: whether the log holds the true poses.
        has_gyro: whether it holds the turn rates of a gyro.
        noise: how far the ranges scatter, learned from the scans; None where too few beams meet walls.
    """

    path: Path
    scans: int
    beams: int
    field_of_view: float
    resolution: float
    T_robot_laser: tuple[float, float, float]
    range_min: float
    range_max: float
    range_quartiles: tuple[float, float, float, float, float]
    no_return_share: float
    empty_scans: int
    duration: float
    stamps_stepping_back: int
    gaps: tuple[tuple[float, float], ...]
    has_odometry: bool
    path_length: float
    turned_angle: float
    skipped_lines: int
    message_counts: Mapping[str, int]
    warnings: tuple[str, ...]
    choices: Mapping[str, str]
    has_truth: bool
    has_gyro: bool
    noise: LaserNoise | None

    def __str__(self) -> str:
        x, y, heading = self.T_robot_laser
        view, step = math.degrees(self.field_of_view), math.degrees(self.resolution)
        shortest, lower, median, upper, longest = self.range_quartiles
        rate = f", {(self.scans - 1) / self.duration:.1f} Hz" if self.duration > 0 and self.scans > 1 else ""
        motion = (
            f"{self.path_length:.1f} m, {math.degrees(self.turned_angle):.0f}° turned"
            if self.has_odometry
            else "none that says anything"
        )
        rows = {
            "log": str(self.path),
            "scans": f"{self.scans} in {self.duration:.1f} s{rate}",
            "beams": f"{self.beams} over {view:g}°, {step:g}° apart",
            "laser": f"x {x:g} m, y {y:g} m, heading {math.degrees(heading):g}° on the robot",
            "usable": f"{self.range_min:g} m to {self.range_max:.2f} m",
            "returns": (
                f"{shortest:.2f} m to {longest:.2f} m, quartiles {lower:.2f}, {median:.2f} and {upper:.2f} m"
                if math.isfinite(median)
                else "none"
            ),
            "no return": f"{100 * self.no_return_share:.1f} % of the beams, {self.empty_scans} scans without any",
            "noise": self._told_noise(),
            "odometry": motion,
            "gyro": self._told_gyro(),
            "stamps": ", ".join([f"step back {self.stamps_stepping_back} times", *self._told_gaps()]),
            "messages": ", ".join(f"{count} {name}" for name, count in self.message_counts.items()),
        }
        if self.skipped_lines:
            rows["skipped"] = f"{self.skipped_lines} malformed lines"
        lines = [f"{name:<10}{value}" for name, value in rows.items() if value]
        chosen = [f"{'chosen':<10}{subject}: {choice}" for subject, choice in self.choices.items()]
        return "\n".join([*lines, *chosen, *(f"{'warning':<10}{warning}" for warning in self.warnings)])

    def _told_gyro(self) -> str:
        if not self.has_gyro:
            return ""
        if self.has_odometry:
            return "turn rates, not used as there is odometry"
        return "turn rates: odometry of the heading, if the scans confirm it"

    def _told_noise(self) -> str:
        if self.noise is None:
            return ""
        growing = f", and {100 * self.noise.per_metre:.1f} % of the range" if self.noise.per_metre > 0.0005 else ""
        return f"ranges scatter by {1000 * self.noise.constant:.1f} mm{growing} (one standard deviation)"

    def _told_gaps(self) -> list[str]:
        if not self.gaps:
            return []
        longest = ", ".join(f"{length:.1f} s after {start:.1f} s" for start, length in self.gaps[:_TOLD_GAPS])
        return [f"{len(self.gaps)} gaps, the longest {longest}" if len(self.gaps) > 1 else f"a gap of {longest}"]


def describe_log(log: Log) -> LogInfo:
    """Count and measure what a log holds."""
    returned = np.isfinite(log.ranges)
    returns = log.ranges[returned]
    quartiles = np.quantile(returns, [0.0, 0.25, 0.5, 0.75, 1.0]) if len(returns) else np.full(5, np.nan)
    steps = np.diff(log.odometry, axis=0)
    x, y, heading = log.geometry.T_robot_laser.tolist()
    shortest, lower, median, upper, longest = quartiles.tolist()
    return LogInfo(
        path=log.path,
        scans=len(log),
        beams=log.geometry.n_beams,
        field_of_view=log.geometry.field_of_view,
        resolution=log.geometry.resolution,
        T_robot_laser=(x, y, heading),
        range_min=log.geometry.range_min,
        range_max=log.geometry.range_max,
        range_quartiles=(shortest, lower, median, upper, longest),
        no_return_share=float(1.0 - returned.mean()),
        empty_scans=int(np.count_nonzero(~returned.any(axis=1))),
        duration=float(np.ptp(log.stamps)),
        stamps_stepping_back=int(np.count_nonzero(np.diff(log.stamps) < 0)),
        gaps=_gaps(log.stamps),
        has_odometry=log.has_odometry,
        path_length=float(np.hypot(steps[:, 0], steps[:, 1]).sum()),
        turned_angle=float(np.abs(wrap_angle(steps[:, 2])).sum()),
        skipped_lines=log.skipped_lines,
        message_counts=log.message_counts,
        warnings=log.warnings,
        choices=log.choices,
        has_truth=log.truth is not None,
        has_gyro=log.gyro is not None,
        noise=learn_laser_noise(log),
    )


def _gaps(stamps: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
    """Beginning after the first stamp and length of each gap [s], the longest first."""
    steps = np.diff(stamps)
    forward = steps[steps > 0.0]
    if not len(forward):
        return ()
    gaps = np.flatnonzero((steps > _GAP_PERIODS * np.median(forward)) & (steps > _SHORTEST_GAP))
    longest_first = gaps[np.argsort(-steps[gaps], kind="stable")]
    return tuple((float(stamps[gap] - stamps[0]), float(steps[gap])) for gap in longest_first)
