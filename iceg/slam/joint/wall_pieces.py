"""What a run tells of the walls: the pieces that the joint refinement ended with, as short straight segments."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from graph.arrays import Floats, Ints
from graph.se2 import transform_points
from graph.short_repr import short_repr
from iceg.slam.joint.covariance import Walls


@dataclass(frozen=True, slots=True, kw_only=True)
class WallPieces:
    """Short straight pieces of wall, at most half a metre long each.

    Attributes:
        ends: (m, 2, 2) both ends in the map frame [m]; the side that was seen lies to the left.
        points: (m,) how many points lie on each.
        deviations: (m,) root mean square distance of these from the piece [m].
        key_poses: (m,) from how many key poses it was seen.
    """

    ends: Floats
    points: Ints
    deviations: Floats
    key_poses: Ints

    __repr__ = short_repr

    def __len__(self) -> int:
        """Number of pieces."""
        return len(self.points)

    @classmethod
    def none(cls) -> Self:
        """Without a piece, as where nothing was refined."""
        whole = np.empty(0, np.int64)
        return cls(ends=np.empty((0, 2, 2)), points=whole, deviations=np.empty(0), key_poses=whole)

    def moved(self, T_new_map: Floats) -> Self:
        """The same in another frame, (3,) T_new_map."""
        return replace(self, ends=transform_points(T_new_map, self.ends))

    @classmethod
    def of(cls, walls: Walls, spreads: Floats, key_starts: Ints, T_map_walls: Floats, min_weight: float) -> Self:
        """From the walls of a joint refinement.

        Args:
            walls: pieces, and how the points lie on them.
            spreads: (n,) variance of each point in that of a typical one.
            key_starts: (k + 1,) first point of each key pose.
            T_map_walls: (3,) where the walls' frame lies in the map.
            min_weight: Cauchy weight from which on a point tells how far its piece reaches.

        Returns:
            The pieces that some points lie on, in the order of the walls.
        """
        chosen = np.flatnonzero((walls.piece_of >= 0) & (walls.weights * spreads >= min_weight))
        piece, n = walls.piece_of[chosen], len(walls.lines)
        x, y, normal_x, normal_y = walls.lines.T
        at_middle = x * normal_y - y * normal_x
        placed = walls.placed[chosen]
        along = placed[:, 0] * normal_y[piece] - placed[:, 1] * normal_x[piece] - at_middle[piece]
        low, high = np.full(n, np.inf), np.full(n, -np.inf)
        np.minimum.at(low, piece, along)
        np.maximum.at(high, piece, along)
        points = np.bincount(piece, minlength=n)
        squares = np.bincount(piece, walls.residuals[chosen] ** 2, minlength=n)
        present = points > 0
        lines = walls.lines[present]
        reaches = np.stack([low[present], high[present]], axis=1)
        tangents = np.stack([lines[:, 3], -lines[:, 2]], axis=1)
        ends = lines[:, None, :2] + reaches[:, :, None] * tangents[:, None, :]
        return cls(
            ends=transform_points(T_map_walls, ends),
            points=points[present],
            deviations=np.sqrt(squares[present] / points[present]),
            key_poses=_key_poses(piece, chosen, key_starts, n)[present],
        )


def _key_poses(piece: Ints, points: Ints, key_starts: Ints, n: int) -> Ints:
    """(n,) from how many key poses the points on each of n pieces were seen; points come key pose by key pose."""
    keys = len(key_starts) - 1
    key = np.repeat(np.arange(keys), np.diff(np.searchsorted(points, key_starts)))
    return np.bincount(np.unique(piece * keys + key) // keys, minlength=n)
