"""Odometry of the heading alone: turns are known, steps are taken to go on as they went."""

from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.odometry import OdometryModel
from graph.se2 import between, expmap, logmap
from iceg.slam.recording.steps import chained
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingNoise:
    """Noise of turns, whatever moves the robot ahead; the names are those of `OdometryModel`."""

    heading_floor: float
    heading_per_metre: float
    heading_per_radian: float

    def within(self, model: OdometryModel) -> OdometryModel:
        """The model of a motion whose turns are known so well."""
        return replace(model, **asdict(self))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingOdometry:
    """Headings that take the place of odometry's, which says nothing of translation.

    Attributes:
        headings: (n_scans,) at the scans, all turns counted, from 0 [rad].
        noise: of its turns from one key scan to the next.
        lasting_noise: the same for a graph, see `OdometryCalibration`.
        unforeseen: nearly all steps from scan to scan end nearer than this to where a constant velocity ends [m] …
        unforeseen_sigma: … and the standard deviation of that, along either axis [m].
    """

    headings: NDArray[np.float64]
    noise: HeadingNoise
    lasting_noise: HeadingNoise
    unforeseen: float
    unforeseen_sigma: float

    def step_noise(self, model: OdometryModel) -> OdometryModel:
        """The model of a motion at constant velocity, on the arcs of the turns, at least as wide as steps demand."""
        return replace(
            self.noise.within(model),
            along_floor=max(model.along_floor, self.unforeseen_sigma),
            across_floor=max(model.across_floor, self.unforeseen_sigma),
        )


def with_headings(track: Track, headings: NDArray[np.float64]) -> NDArray[np.float64]:
    """The way of a track if it had turned otherwise.

    Args:
        track: what the front end found.
        headings: (n_scans,) [rad].

    Returns:
        (n_scans, 3): from scan to scan as far ahead and aside as the track, on the arc of the other turn.
    """
    poses = track.trajectory(np.array([key.T_track_robot for key in track.keys]))
    twists = logmap(between(poses[:-1], poses[1:]))
    twists[:, 2] = np.diff(headings)
    return chained(poses[0], expmap(twists))


def unforeseen_steps(track: Track, headings: NDArray[np.float64], share: float) -> float:
    """How far such a share of steps ends from where the one before would, on arcs of (n_scans,) headings [m]."""
    poses = track.trajectory(np.array([key.T_track_robot for key in track.keys]))
    steps = between(poses[:-1], poses[1:])
    expected = logmap(steps[:-1])
    expected[:, 2] = np.diff(headings)[1:]
    apart = steps[1:, :2] - expmap(expected)[:, :2]
    return float(np.quantile(np.hypot(apart[:, 0], apart[:, 1]), share))
