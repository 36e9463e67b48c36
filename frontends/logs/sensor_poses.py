"""Poses that a log keeps in messages of their own, with or without a time, brought to the scans."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frontends.logs import odometry_lines
from graph.se2 import wrap_angle

_ALTERNATING = 0.9  # share of the scans that have exactly one pose message before them


@dataclass(slots=True, kw_only=True)
class SensorPoses:
    """The poses of one sensor as recorded, in file order.

    Attributes:
        poses: x, y [m] and heading [rad] of each message.
        times: of each message [s], NaN where it has none.
        places: of each message in the file, counted over all messages.
    """

    poses: list[tuple[float, float, float]] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    places: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        """Number of messages."""
        return len(self.poses)

    def add(self, pose: tuple[float, float, float], time: float, place: int) -> None:
        """One more message."""
        self.poses.append(pose)
        self.times.append(time)
        self.places.append(place)

    def at_scans(self, places: NDArray[np.int64], stamps: NDArray[np.float64]) -> NDArray[np.float64]:
        """The pose at each scan.

        The message just before a scan, else the one just after, counts for it if they have the same time; else the
        scan lies between the two by time. Without times the one before counts where messages and scans alternate;
        where they do not, a scan lies between the two by its place in the file.

        Args:
            places: (n,) of the scans in the file.
            stamps: (n,) of the scans [s].

        Returns:
            (n, 3) poses.
        """
        own = np.array(self.poses)
        times = np.array(self.times)
        after = np.searchsorted(np.array(self.places), places)
        before = np.maximum(after - 1, 0)
        after = np.minimum(after, len(own) - 1)
        at_scan = self._by_place(own, places, before)
        t_before, t_after = times[before], times[after]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            within = (t_before <= stamps) & (stamps <= t_after) & (t_before < t_after)
            share = np.where(within, (stamps - t_before) / (t_after - t_before), 0.0)[:, None]
        step = own[after] - own[before]
        step[:, 2] = wrap_angle(step[:, 2])
        at_scan = np.where(within[:, None], own[before] + share * step, at_scan)
        at_scan = np.where((t_after == stamps)[:, None], own[after], at_scan)
        at_scan = np.where((t_before == stamps)[:, None], own[before], at_scan)
        at_scan[:, 2] = wrap_angle(at_scan[:, 2])
        return at_scan

    def _by_place(
        self, own: NDArray[np.float64], places: NDArray[np.int64], before: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        seen = np.searchsorted(np.array(self.places), places)
        if np.mean(np.diff(seen, prepend=0) == 1) >= _ALTERNATING:
            nearest: NDArray[np.float64] = own[before]
            return nearest
        return odometry_lines.at_scans(self.poses, np.searchsorted(places, self.places).tolist(), len(places))
