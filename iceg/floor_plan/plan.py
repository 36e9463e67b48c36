"""A floor plan: straight walls in metres, sure ones and those seen with doubt."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iceg.floor_plan.config import FloorPlanConfig
from iceg.floor_plan.corners import with_corners
from iceg.floor_plan.wall_lines import StraightWall, straight_walls, united
from iceg.slam.joint.wall_pieces import WallPieces


@dataclass(frozen=True, slots=True, kw_only=True)
class FloorPlan:
    """Walls as straight lines.

    Attributes:
        name: of the log.
        walls: (n, 2, 2) both ends of each wall in the map frame [m].
        is_sure: (n,) whether it is beyond doubt: long enough, and seen often and densely enough.
    """

    name: str
    walls: NDArray[np.float64]
    is_sure: NDArray[np.bool_]

    @property
    def sure(self) -> NDArray[np.float64]:
        """(m, 2, 2) the walls beyond doubt."""
        return self.walls[self.is_sure]

    @property
    def doubtful(self) -> NDArray[np.float64]:
        """(m, 2, 2) the others."""
        return self.walls[~self.is_sure]

    @property
    def box(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max of the walls beyond doubt [m], or of all without one; zeros without any."""
        if not len(self.walls):
            return 0.0, 0.0, 0.0, 0.0
        points = (self.sure if self.is_sure.any() else self.walls).reshape(-1, 2)
        (x_min, y_min), (x_max, y_max) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        return x_min, x_max, y_min, y_max


def floor_plan(pieces: WallPieces, config: FloorPlanConfig | None = None, *, name: str = "") -> FloorPlan:
    """The floor plan of a run.

    Args:
        pieces: of wall, as a run has them.
        config: what counts as one wall; the defaults when left out.
        name: of the log.
    """
    config = config or FloorPlanConfig()
    lines = united(straight_walls(pieces, config), config)
    walls = [wall for wall in with_corners(lines, config) if wall.length >= config.least_length]
    return FloorPlan(
        name=name,
        walls=np.array([wall.ends for wall in walls]).reshape(-1, 2, 2),
        is_sure=np.array([_is_sure(wall, config) for wall in walls], dtype=np.bool_),
    )


def _is_sure(wall: StraightWall, config: FloorPlanConfig) -> bool:
    return (
        wall.length >= config.sure_length
        and wall.key_poses >= config.sure_key_poses
        and wall.points >= config.sure_points * wall.length
    )
