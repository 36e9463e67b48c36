"""The beams of several scans as arrays, for kernels that go through all of them at once."""

from collections.abc import Sequence, Sized
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan


class Sweeps(NamedTuple):
    """Scans and the poses they were taken at; scan k has the beams from starts[k] to starts[k + 1].

    Attributes:
        T_ref_robots: (m, 3) pose of the robot at each.
        T_robot_lasers: (m, 3) mount of its laser.
        first_bearings: (m,) of the first beam in the laser frame [rad].
        resolutions: (m,) angle between two beams [rad].
        ranges: (n,) float32 [m], NaN without return.
        starts: (m + 1,).
    """

    T_ref_robots: NDArray[np.float64]
    T_robot_lasers: NDArray[np.float64]
    first_bearings: NDArray[np.float64]
    resolutions: NDArray[np.float64]
    ranges: NDArray[np.float32]
    starts: NDArray[np.int64]


def sweeps_of(scans: Sequence[Scan], T_ref_robots: NDArray[np.float64]) -> Sweeps:
    """The beams of one scan or more, taken at (m, 3) poses."""
    geometries = [scan.geometry for scan in scans]
    ranges = [scan.ranges for scan in scans]
    return Sweeps(
        T_ref_robots=T_ref_robots,
        T_robot_lasers=np.array([geometry.T_robot_laser for geometry in geometries]),
        first_bearings=np.array([geometry.bearings[0] for geometry in geometries]),
        resolutions=np.array([geometry.resolution for geometry in geometries]),
        ranges=joined(ranges),
        starts=starts_of(ranges),
    )


def starts_of(arrays: Sequence[Sized]) -> NDArray[np.int64]:
    """(n + 1,) where each of n arrays begins when they follow each other."""
    return np.array([0, *accumulate(map(len, arrays))], dtype=np.int64)


def joined(arrays: list[NDArray[Any]]) -> NDArray[Any]:
    """Arrays, (n, ...) each, one after the other; a single one as it is."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)
