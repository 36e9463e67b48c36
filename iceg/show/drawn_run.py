"""What pictures show of a run, whether it has just ended or was read back from its folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from iceg.run_folder import RunFolder
from iceg.show.map_image import MapLayers
from iceg.slam.closures.closure import Closure, joined_scans

if TYPE_CHECKING:
    from iceg.maps.feature_map import Landmarks
    from iceg.maps.grid import OccupancyGrid
    from iceg.run_result.slam_result import SlamResult


@dataclass(frozen=True, kw_only=True)
class DrawnRun:
    """A run as the pictures take it.

    Attributes:
        name: of the log.
        stamps: (n,) of the scans [s]; may step back.
        trajectory: (n, 3) T_map_robot of each scan.
        key_scans: (k,) scan index of each key pose.
        key_poses: (k, 3) T_map_robot.
        covariances: (k, 3, 3) in the tangent space at each key pose.
        grid: the occupancy grid.
        landmarks: the feature map.
        closures: loop closures tried.
    """

    name: str
    stamps: NDArray[np.float64]
    trajectory: NDArray[np.float64]
    key_scans: NDArray[np.int64]
    key_poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    grid: "OccupancyGrid"
    landmarks: "Landmarks"
    closures: Sequence[Closure]

    def layers(self) -> MapLayers:
        """All that lies on the map."""
        return MapLayers(
            grid=self.grid,
            trajectory=self.trajectory,
            key_poses=self.key_poses,
            landmarks=self.landmarks,
            closures=joined_scans(self.closures),
            name=self.name,
            seconds=duration(self.stamps),
        )


def drawn_run(run: "SlamResult | RunFolder") -> DrawnRun:
    """What pictures show of a run.

    Args:
        run: what `iceg.run` has returned, or `iceg.read_run_folder`.
    """
    if isinstance(run, RunFolder):
        name, stamps, trajectory = run.log_name, run.trajectory.stamps, run.trajectory.poses
    else:
        name, stamps, trajectory = run.log.path.name, run.log.stamps, run.trajectory
    return DrawnRun(
        name=name,
        stamps=stamps,
        trajectory=trajectory,
        key_scans=run.key_scans,
        key_poses=run.key_poses,
        covariances=run.covariances,
        grid=run.grid,
        landmarks=run.landmarks,
        closures=run.closures,
    )


def duration(stamps: NDArray[np.float64]) -> float | None:
    """Seconds from the first stamp of a log to its latest; None where the log has no time."""
    seconds = float(stamps.max() - stamps[0]) if len(stamps) else 0.0
    return seconds if seconds > 0.0 else None
