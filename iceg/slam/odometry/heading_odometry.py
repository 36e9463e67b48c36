"""Odometry of the heading alone: turns are known, steps are taken to go on as they went."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from graph.arrays import Floats
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
    """

    headings: Floats
    noise: HeadingNoise
    lasting_noise: HeadingNoise


def with_headings(track: Track, headings: Floats) -> Floats:
    """The way of a track if it had turned otherwise.

    Args:
        track: what the front end found.
        headings: (n_scans,) [rad].

    Returns:
        (n_scans, 3): from scan to scan as far ahead and aside as the track, on the arc of the other turn.
    """
    poses = track.T_track_scans
    twists = logmap(between(poses[:-1], poses[1:]))
    twists[:, 2] = np.diff(headings)
    return chained(poses[0], expmap(twists))
