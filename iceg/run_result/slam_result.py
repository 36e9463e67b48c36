"""What a run found: trajectory, graph, maps, closures and warnings, and what can be asked of them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.counted import counted
from graph.pose_graph import PoseGraph
from iceg.config import Config
from iceg.maps.feature_map import Landmarks
from iceg.maps.grid import OccupancyGrid
from iceg.result_tables import RunTables, TableName
from iceg.run_result.distance import Distance, Sighting, measured_distance, sighting_at
from iceg.run_result.joint_covariance import JointCovariance
from iceg.run_result.run_summary import RunSummary
from iceg.slam.closures.attempt import Verdict
from iceg.slam.closures.closure import Closure
from iceg.slam.findings import Findings
from iceg.slam.joint.wall_pieces import WallPieces
from iceg.slam.run_warning import RunWarning

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamResult:
    """What a run found.

    Attributes:
        log: the log.
        config: the settings.
        trajectory: (n_scans, 3) T_map_robot of every scan, in file order.
        key_scans: (k,) which scans are key scans.
        key_poses: (k, 3) their T_map_robot.
        covariances: (k, 3, 3) their marginal covariances, tangent space at each.
        joint: how the errors of the key poses hang together.
        graph: the factors as they were measured. The key poses rest on the walls that scans share, too, and are not
            quite the optimum of the factors alone.
        landmarks: the feature map, expired landmarks included.
        grid: the occupancy grid.
        walls: short straight pieces of wall, none where poses and map were not refined together.
        closures: every loop closure tried.
        run_warnings: what the run has found to be wrong, besides what is about the log, with kind and place.
        summary: counts, warnings, seconds per stage and calibration.
        findings: what the run found before it concluded, scans that were cut since included: `resolve` concludes anew
            from it.
    """

    log: Log
    config: Config
    trajectory: NDArray[np.float64]
    key_scans: NDArray[np.int64]
    key_poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    joint: JointCovariance
    graph: PoseGraph
    landmarks: Landmarks
    grid: OccupancyGrid
    walls: WallPieces
    closures: list[Closure]
    run_warnings: tuple[RunWarning, ...]
    summary: RunSummary
    findings: Findings

    @property
    def warnings(self) -> tuple[str, ...]:
        """All that may be wrong with it, a sentence each: first what is about the log, then what the run has found."""
        return tuple(self.summary["warnings"])

    def __repr__(self) -> str:
        accepted = sum(closure.verdict is Verdict.ACCEPTED for closure in self.closures)
        return (
            f"SlamResult({self.log.path.name}: {counted(len(self.trajectory), 'scan')}, "
            f"{counted(len(self.key_scans), 'key pose')}, {counted(len(self.graph.factors), 'factor')}, "
            f"{accepted} of {counted(len(self.closures), 'closure')} accepted, "
            f"{counted(len(self.landmarks.settled()), 'landmark')}, {counted(len(self.warnings), 'warning')})"
        )

    def sighting(self, x: float, y: float) -> Sighting:
        """The place (x, y) of the map [m], as the key scan saw it that saw it from closest.

        Within 10 cm of a wall that is the wall: the nearest end of a beam of that scan.

        Raises:
            DistanceError: no key scan looked there.
        """
        return sighting_at(np.array([x, y]), self.log, self.key_scans, self.key_poses)

    def distance(self, a: Sighting | tuple[float, float], b: Sighting | tuple[float, float]) -> Distance:
        """How far two points are apart, and how well that is known.

        The standard deviation is that of the joint covariance of the two poses that saw the points, and of the laser
        where a point is the end of a beam.

        Args:
            a: a point that a scan saw, or x, y in the map [m], for which see `sighting`.
            b: the other.

        Raises:
            DistanceError: no key scan looked there, or a scan that the log does not have.
        """
        a, b = (point if isinstance(point, Sighting) else self.sighting(*point) for point in (a, b))
        return measured_distance(a, b, self.trajectory, self.key_scans, self.joint, self.log, self.summary["laser"])

    def _repr_html_(self) -> str:
        """A small map and the figures, for notebooks."""
        from iceg.show.result_html import result_html

        return result_html(self)

    def tables(self) -> RunTables:
        """The result as tables of plain columns, for pandas, CSV and Parquet."""
        tracking = (self.config.front_end.tracking_distance, self.config.front_end.tracking_angle)
        return RunTables(
            stamps=self.log.stamps,
            trajectory=self.trajectory,
            key_scans=self.key_scans,
            key_poses=self.key_poses,
            covariances=self.covariances,
            tracking=tracking,
            closures=self.closures,
            landmarks=self.landmarks,
            factors=self.graph.factors,
        )

    def to_frame(self, name: TableName) -> "pd.DataFrame":
        """One table of the result for pandas.

        Args:
            name: "trajectory", "key_poses", "closures", "landmarks" or "factors".

        Raises:
            TableExportError: there is no such table, or no pandas.
        """
        return self.tables().frame(name)

    def scan_covariances(self) -> NDArray[np.float64]:
        """(n_scans, 3, 3) covariance of every scan's pose, see `iceg.run_result.scan_covariances`."""
        return self.tables().scan_covariances()
