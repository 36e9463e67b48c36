"""The field's benchmark metric: how well a trajectory reproduces hand-verified relative poses.

Kümmerle et al., *On Measuring the Accuracy of SLAM Algorithms*, 2009.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graph.se2 import between, compose, inverse, wrap_angle
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.trajectory import check_scan_numbers
from iceg.tables import read_blank_separated_table, read_csv_table

ErrorForm = Literal["metric", "cartographer"]

_CSV_COLUMNS = ("scan_i", "scan_j", "x_m", "y_m", "theta_rad", "certain")
_STAMP_COLUMNS = ("stamp_i", "stamp_j", "x", "y", "z", "roll", "pitch", "yaw")
_STAMP_TOLERANCE_S = 0.02
"""A stamp farther than this from that of any scan names none for certain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Relations:
    """n relative poses known from elsewhere.

    Attributes:
        scans_i: (n,) int, the scan whose frame is the reference, counted from 0 in file order.
        scans_j: (n,) int, the scan whose pose is given.
        T_i_j: (n, 3) pose of scan j in the frame of scan i: x [m], y [m], heading [rad].
        dropped: how many rows were left out because they could not be tied to one scan each.
        path: where they were read from.
    """

    scans_i: NDArray[np.int64]
    scans_j: NDArray[np.int64]
    T_i_j: NDArray[np.float64]
    dropped: int
    path: Path

    def __len__(self) -> int:
        """Number of relations."""
        return len(self.T_i_j)


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorStatistics:
    """Summary of n non-negative errors; `std` is the sample standard deviation (NaN for n = 1)."""

    mean: float
    std: float
    median: float
    p95: float
    max: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RelationErrors:
    """What is left between a trajectory and the relations.

    Attributes:
        translation: (n,) [m].
        rotation: (n,) [rad], not negative.
    """

    translation: NDArray[np.float64]
    rotation: NDArray[np.float64]


def read_relations_csv(path: Path | str) -> Relations:
    """Read relations by scan index; only rows with `certain` = 1 are kept, the others counted as dropped.

    Args:
        path: a CSV with the header `scan_i,scan_j,x_m,y_m,theta_rad,certain`.

    Raises:
        TableError: the file cannot be read, its header or a row is not as expected.
        EvaluationError: nothing in it is certain, or what should name a scan does not.
    """
    path = Path(path)
    table = read_csv_table(path, _CSV_COLUMNS)
    certain = table[:, 5] == 1
    if not certain.any():
        raise EvaluationError(f"{path}: none of its {len(table)} relations is certain")
    check_scan_numbers(table[:, :2], path)
    scans = table[certain, :2].astype(np.int64)
    return Relations(
        scans_i=scans[:, 0],
        scans_j=scans[:, 1],
        T_i_j=table[certain, 2:5],
        dropped=int((~certain).sum()),
        path=path,
    )


def read_relations(path: Path | str, stamps: NDArray[np.float64]) -> Relations:
    """Read relations in the benchmark's original format, by stamp, and tie them to the scans of a log.

    Args:
        path: lines `stamp_i stamp_j x y z roll pitch yaw`, separated by blanks.
        stamps: (n_scans,) of the log, in file order [s].

    Returns:
        The relations both of whose stamps name one scan: the nearest stamp lies within 20 ms and the second nearest
        at least twice as far away. The others are counted as dropped.

    Raises:
        TableError: the file cannot be read or a line is not 8 numbers.
        EvaluationError: no relation could be tied to the log.
    """
    path = Path(path)
    table = read_blank_separated_table(path, _STAMP_COLUMNS)
    scans_i, ok_i = nearest_scans(table[:, 0], stamps)
    scans_j, ok_j = nearest_scans(table[:, 1], stamps)
    kept = ok_i & ok_j
    if not kept.any():
        raise EvaluationError(
            f"{path}: none of its {len(table)} relations has stamps of this log: "
            f"they run from {table[:, :2].min():.3f} to {table[:, :2].max():.3f}, "
            f"the log's from {stamps.min():.3f} to {stamps.max():.3f}"
        )
    return Relations(
        scans_i=scans_i[kept],
        scans_j=scans_j[kept],
        T_i_j=table[kept][:, [2, 3, 7]],
        dropped=int((~kept).sum()),
        path=path,
    )


def nearest_scans(
    queries: NDArray[np.float64], stamps: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The scan each stamp belongs to, and whether that is beyond doubt.

    Args:
        queries: (n,) stamps [s].
        stamps: (n_scans,) in file order; may step back and repeat [s].

    Returns:
        (n,) scan indices and (n,) bool: the nearest stamp lies within 20 ms and no other is less than twice as far.
    """
    order = np.argsort(stamps, kind="stable")
    sorted_stamps = np.concatenate([[-np.inf, -np.inf], stamps[order], [np.inf, np.inf]])
    right = np.searchsorted(sorted_stamps, queries)
    around = right[:, None] + np.arange(-2, 2)
    distances = np.abs(sorted_stamps[around] - queries[:, None])
    nearness = np.argsort(distances, axis=1, kind="stable")
    first, second = np.take_along_axis(distances, nearness, axis=1)[:, :2].T
    nearest = np.take_along_axis(around, nearness, axis=1)[:, 0] - 2
    certain = (first <= _STAMP_TOLERANCE_S) & (second > 0) & (second >= 2 * first)
    return order[np.clip(nearest, 0, len(stamps) - 1)], certain


def relation_errors(
    T_map_robot: NDArray[np.float64], relations: Relations, form: ErrorForm = "metric"
) -> RelationErrors:
    """Compare a trajectory with relations.

    Args:
        T_map_robot: (n_scans, 3), one pose per scan in file order.
        relations: what is known.
        form: "metric" takes the component-wise difference of the two relative poses, as the benchmark's own
            evaluator does; "cartographer" the norm of `T_i_j(trajectory) * T_i_j(relation)⁻¹`, as Cartographer's
            does. They differ in translation where the heading is off.

    Raises:
        EvaluationError: the relations reach beyond the trajectory.
    """
    last = int(max(relations.scans_i.max(), relations.scans_j.max()))
    if last >= len(T_map_robot):
        raise EvaluationError(
            f"{relations.path}: its relations reach scan {last}, but the trajectory has {len(T_map_robot)} rows; "
            "expected one row per scan of the same log"
        )
    T_estimated = between(T_map_robot[relations.scans_i], T_map_robot[relations.scans_j])
    componentwise = T_estimated - relations.T_i_j
    difference = componentwise if form == "metric" else compose(T_estimated, inverse(relations.T_i_j))
    return RelationErrors(
        translation=np.hypot(difference[:, 0], difference[:, 1]),
        rotation=np.abs(wrap_angle(difference[:, 2])),
    )


def triangle_errors(relations: Relations) -> RelationErrors:
    """How far relations contradict one another: (a, b) and (b, c) composed, against (a, c) where that is given too.

    Three relations err there. If theirs are alike and independent, a third of the mean square is the share of one, and
    no trajectory can agree with the relations better than that.

    Args:
        relations: between any scans.

    Returns:
        One error for each triangle, in the order of the relations; there may be none.
    """
    known: dict[int, dict[int, NDArray[np.float64]]] = {}
    for i, j, T_i_j in zip(relations.scans_i.tolist(), relations.scans_j.tolist(), relations.T_i_j, strict=True):
        known.setdefault(i, {})[j] = T_i_j
    triangles = [
        between(T_a_c, compose(T_a_b, T_b_c))
        for from_a in known.values()
        for b, T_a_b in from_a.items()
        for c, T_b_c in known.get(b, {}).items()
        if (T_a_c := from_a.get(c)) is not None
    ]
    errors = np.array(triangles).reshape(-1, 3)
    return RelationErrors(translation=np.hypot(errors[:, 0], errors[:, 1]), rotation=np.abs(errors[:, 2]))


def on_odometry_grid(
    relations: Relations, odometry: NDArray[np.float64], spacing: float, tolerance: float = 1e-4
) -> NDArray[np.bool_]:
    """Which relations are raw odometry shifted from one point of a square grid to another.

    Such relations come from a matcher that tried places on a grid around odometry's: the nearest of them is still 0.38
    spacings off on average. The grid's directions are not known, so lengths are compared; by chance, a share of
    4.3 · tolerance / spacing would agree.

    Args:
        relations: of a log.
        odometry: (n_scans, 3) of the same log.
        spacing: of the grid [m].
        tolerance: within which lengths agree [m].

    Returns:
        (m,) for each relation that odometry misses by less than 2.5 spacings, in their order.
    """
    T_i_j = between(odometry[relations.scans_i], odometry[relations.scans_j])
    shift = np.hypot(*(relations.T_i_j - T_i_j)[:, :2].T)
    lengths = spacing * np.sqrt([0.0, 1.0, 2.0, 4.0, 5.0])
    near = shift[shift < 2.5 * spacing]
    return np.asarray(np.abs(near[:, None] - lengths).min(axis=1) < tolerance)


def error_statistics(errors: NDArray[np.float64]) -> ErrorStatistics:
    """Mean, sample standard deviation (n − 1), median, 95th percentile and maximum of (n,) errors."""
    return ErrorStatistics(
        mean=float(errors.mean()),
        std=float(errors.std(ddof=1)) if len(errors) > 1 else float("nan"),
        median=float(np.median(errors)),
        p95=float(np.percentile(errors, 95)),
        max=float(errors.max()),
    )
