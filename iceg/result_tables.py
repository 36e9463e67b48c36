"""The results of a run as tables of plain columns: for pandas, CSV and Parquet."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graph.atomic import write_atomically
from graph.errors import IcegError, reason
from graph.factors import Factor
from graph.short_repr import short_repr
from iceg.ice.features import KIND_NAMES
from iceg.maps.feature_map import Landmarks
from iceg.run_result.scan_covariances import scan_covariances, tracking_covariances
from iceg.slam.closures.closure import Closure

if TYPE_CHECKING:
    import pandas as pd

TableName = Literal["trajectory", "key_poses", "closures", "landmarks", "factors"]
TABLES: tuple[TableName, ...] = get_args(TableName)
Columns = dict[str, NDArray[Any]]

_UPPER = np.triu_indices(3)
_COVARIANCE = ("xx", "xy", "xtheta", "yy", "ytheta", "thetatheta")
_NONE = -1


class TableExportError(IcegError):
    """A table that there is not, or that cannot be made or written."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTables:
    """What the tables of a run are made of.

    Attributes:
        stamps: (n,) of every scan, in file order [s].
        trajectory: (n, 3) T_map_robot of every scan.
        key_scans: (k,) which scans are key scans.
        key_poses: (k, 3) T_map_robot.
        covariances: (k, 3, 3) of the key poses, tangent space at each.
        tracking: standard deviations of a pose between two key scans where no factor says: x and y [m], heading [rad].
        closures: every loop closure tried.
        landmarks: the feature map.
        factors: of the graph.
    """

    stamps: NDArray[np.float64]
    trajectory: NDArray[np.float64]
    key_scans: NDArray[np.int64]
    key_poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    tracking: tuple[float, float]
    closures: Sequence[Closure]
    landmarks: Landmarks
    factors: Sequence[Factor]

    __repr__ = short_repr

    def columns(self, name: str) -> Columns:
        """One table, column by column; lengths in metres, angles in radians, variances in their squares.

        Args:
            name: one of `TABLES`.

        Raises:
            TableExportError: there is no such table.
        """
        if name not in TABLES:
            raise TableExportError(f"found the table '{name[:40]}', expected one of {', '.join(TABLES)}")
        return {
            "trajectory": self._trajectory,
            "key_poses": self._key_poses,
            "closures": self._closures,
            "landmarks": self._landmarks,
            "factors": self._factors,
        }[name]()

    def frame(self, name: str) -> "pd.DataFrame":
        """The same as a pandas table.

        Raises:
            TableExportError: there is no such table, or no pandas.
        """
        try:
            import pandas as pd
        except ImportError as err:
            raise TableExportError("a frame needs pandas, which is not installed: pip install 'iceg[tables]'") from err
        return pd.DataFrame(self.columns(name))

    def scan_covariances(self) -> NDArray[np.float64]:
        """(n, 3, 3) covariance of every scan's pose, see `iceg.run_result.scan_covariances`."""
        tracking = tracking_covariances(self.factors, len(self.key_scans), self.tracking)
        return scan_covariances(self.trajectory, self.key_scans, self.covariances, tracking)

    def _trajectory(self) -> Columns:
        covariances = self.scan_covariances()
        scans = {"scan": np.arange(len(self.stamps)), "stamp_s": self.stamps}
        return {**scans, **_poses(self.trajectory), **_covariances(covariances)}

    def _key_poses(self) -> Columns:
        scans = {"key": np.arange(len(self.key_scans)), "scan": self.key_scans, "stamp_s": self.stamps[self.key_scans]}
        return {**scans, **_poses(self.key_poses), **_covariances(self.covariances)}

    def _closures(self) -> Columns:
        kept, number = self.closures, np.float64
        return {
            "scan_i": np.array([closure.scan_i for closure in kept], dtype=np.int64),
            "scan_j": np.array([closure.scan_j for closure in kept], dtype=np.int64),
            **_poses(np.array([closure.T_i_j for closure in kept], dtype=number).reshape(-1, 3)),
            "score": np.array([closure.score for closure in kept], dtype=number),
            "inliers": np.array([closure.inliers for closure in kept], dtype=np.int64),
            "overlap": np.array([closure.overlap for closure in kept], dtype=number),
            "verdict": np.array([closure.verdict.value for closure in kept], dtype=object),
            "reason": np.array([closure.reason for closure in kept], dtype=object),
        }

    def _landmarks(self) -> Columns:
        marks = self.landmarks
        return {
            "id": marks.ids,
            "kind": np.array([KIND_NAMES[kind] for kind in marks.kinds.tolist()], dtype=object),
            "x_m": marks.positions[:, 0],
            "y_m": marks.positions[:, 1],
            "xx": marks.covariances[:, 0, 0],
            "xy": marks.covariances[:, 0, 1],
            "yy": marks.covariances[:, 1, 1],
            "direction_1_rad": marks.directions[:, 0],
            "direction_2_rad": marks.directions[:, 1],
            "direction_1_variance": marks.direction_variances[:, 0],
            "direction_2_variance": marks.direction_variances[:, 1],
            "distance_m": marks.distances,
            "anchor": marks.anchors,
            "first_seen": marks.first_seen,
            "last_seen": marks.last_seen,
            "seen": marks.seen,
            "missed": marks.missed,
            "expired_at": marks.expired_at,
        }

    def _factors(self) -> Columns:
        kept = self.factors
        i = np.array([_NONE if factor.i is None else factor.i for factor in kept], dtype=np.int64)
        j = np.array([factor.j for factor in kept], dtype=np.int64)
        kernels = [factor.kernel for factor in kept]
        return {
            "kind": np.array([factor.kind for factor in kept], dtype=object),
            "i": i,
            "j": j,
            "scan_i": np.where(i < 0, _NONE, self.key_scans[i]),
            "scan_j": self.key_scans[j],
            **_poses(np.array([factor.T_i_j for factor in kept]).reshape(-1, 3)),
            **_covariances(np.array([factor.covariance for factor in kept]).reshape(-1, 3, 3)),
            "kernel": np.array(["" if kernel is None else kernel.name for kernel in kernels], dtype=object),
            "kernel_width": np.array([np.nan if kernel is None else kernel.width for kernel in kernels]),
        }


def write_csv_table(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns as CSV, numbers so that they read back bit for bit, NaN as nothing.

    Raises:
        TableExportError: the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*(column.tolist() for column in columns.values()), strict=True):
        writer.writerow(["" if value != value else value for value in row])  # noqa: PLR0124  NaN
    _write(path, text.getvalue().encode())


def write_parquet_table(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns as Parquet, NaN as it is.

    Raises:
        TableExportError: the file cannot be written, or pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as err:
        raise TableExportError(
            f"{path}: Parquet needs pyarrow, which is not installed: pip install 'iceg[tables]'"
        ) from err
    buffer = io.BytesIO()
    parquet.write_table(pa.table({name: pa.array(column) for name, column in columns.items()}), buffer)
    _write(path, buffer.getvalue())


def _write(path: Path, content: bytes) -> None:
    try:
        write_atomically(path, content)
    except OSError as err:
        raise TableExportError(f"{path}: cannot be written: {reason(err)}") from err


def _poses(poses: NDArray[np.float64]) -> Columns:
    return {"x_m": poses[:, 0], "y_m": poses[:, 1], "theta_rad": poses[:, 2]}


def _covariances(covariances: NDArray[np.float64]) -> Columns:
    """The upper triangle, in the tangent space at the pose: order x, y, θ."""
    rows, columns = _UPPER
    return dict(zip(_COVARIANCE, covariances[:, rows, columns].T, strict=True))
