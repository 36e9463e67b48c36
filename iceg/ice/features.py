"""Features of a scan: corners, ends of walls and intersections."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CORNER, END_OF_WALL, INTERSECTION = 0, 1, 2
KIND_NAMES = ("corner", "end_of_wall", "intersection")


@dataclass(frozen=True, slots=True, kw_only=True)
class Features:
    """The n features of one scan or of a local map, as parallel arrays.

    Attributes:
        kinds: (n,) int8: CORNER, END_OF_WALL or INTERSECTION.
        positions: (n, 2) [m], in the frame of their owner (the robot frame for one scan).
        directions: (n, 2) headings [rad] of the walls that start at the feature. Column 0 is the wall on the
            clockwise side as seen from the laser, column 1 the wall on the counter-clockwise side; NaN where there is
            none: a corner and an intersection have both, an end of wall exactly one (either column).
        covariances: (n, 2, 2) of the positions [m²], same frame.
        direction_variances: (n,) of the directions [rad²].
        distances: (n,) from the laser when observed [m].
        real: (n,) bool; False for a wall end that is only occluded or cut off by the field of view: good for
            hypotheses, no landmark.
    """

    kinds: NDArray[np.int8]
    positions: NDArray[np.float64]
    directions: NDArray[np.float64]
    covariances: NDArray[np.float64]
    direction_variances: NDArray[np.float64]
    distances: NDArray[np.float64]
    real: NDArray[np.bool_]

    def __len__(self) -> int:
        """Number of features."""
        return len(self.kinds)
