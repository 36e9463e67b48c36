"""Reading a folder of results back, to draw or study a run without running it again."""

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from graph.errors import reason
from iceg.ice.features import KIND_NAMES
from iceg.maps.feature_map import Landmarks
from iceg.maps.grid import OccupancyGrid
from iceg.results import CLOSURE_COLUMNS, ResultsError, read_covariances, read_summary, whole_results
from iceg.slam.closures.closure import Closure, Verdict
from iceg.tum import Trajectory, read_tum

_FILES = ("trajectory.tum", "covariances.csv", "closures.csv", "features.geojson", "map.yaml")
_CERTAIN_LOG_ODDS = 3.0
"""What a black or white cell of map.pgm is read as."""
_DARK, _BRIGHT = 0.35 * 255, 0.804 * 255  # map_server's thresholds on 1 - grey / 255


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFolder:
    """What the files of a run say.

    Attributes:
        trajectory: stamped T_map_robot of each scan.
        key_scans: (k,) scan index of each key pose.
        key_poses: (k, 3) T_map_robot.
        covariances: (k, 3, 3) in the tangent space at each key pose.
        grid: the occupancy grid; each cell free, occupied or unknown beyond doubt, as its picture has no more.
        landmarks: the feature map.
        closures: loop closures tried.
    """

    trajectory: Trajectory
    key_scans: NDArray[np.int64]
    key_poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    grid: OccupancyGrid
    landmarks: Landmarks
    closures: tuple[Closure, ...]

    def __repr__(self) -> str:
        accepted = sum(closure.verdict == "accepted" for closure in self.closures)
        return (
            f"RunFolder({len(self.trajectory)} scans, {len(self.key_scans)} key poses, "
            f"{accepted} of {len(self.closures)} closures accepted, {len(self.landmarks)} landmarks)"
        )


def read_run_folder(directory: Path | str) -> RunFolder:
    """Read what a run has left behind.

    Raises:
        IcegError: a file is missing or not as expected, named; or the files are not those of one run.
    """
    directory = Path(directory)
    if not directory.is_dir():
        raise ResultsError(f"{directory}: is no folder, expected one that a run has written")
    if is_of_dp_slam(directory):
        raise ResultsError(f"{directory}: holds results of DP-SLAM, which has no graph, expected those of 'iceg run'")
    missing = [name for name in _FILES if not (directory / name).exists()]
    if missing:
        raise ResultsError(f"{directory}: lacks {', '.join(missing)}, expected a folder that 'iceg run' has written")
    with whole_results(directory):
        return _read(directory)


def _read(directory: Path) -> RunFolder:
    key_scans, key_poses, covariances = read_covariances(directory / "covariances.csv")
    return RunFolder(
        trajectory=read_tum(directory / "trajectory.tum"),
        key_scans=key_scans,
        key_poses=key_poses,
        covariances=covariances,
        grid=read_ros_map(directory / "map.yaml"),
        landmarks=read_geojson(directory / "features.geojson"),
        closures=read_closures(directory / "closures.csv"),
    )


def is_of_dp_slam(directory: Path) -> bool:
    """Whether a folder holds what DP-SLAM has written, which is less than what a run leaves.

    Raises:
        ResultsError: its summary cannot be read.
    """
    return (directory / "summary.json").exists() and read_summary(directory).get("method") == "dp-slam"


def read_ros_map(path: Path) -> OccupancyGrid:
    """Read a grid as `write_ros_map` writes it: an 8-bit PGM beside its YAML.

    Raises:
        ResultsError: a file is missing or not of that form.
    """
    try:
        description = dict(line.split(": ", 1) for line in path.read_text(encoding="ascii").splitlines() if line)
        resolution = float(description["resolution"])
        origin = np.array([float(word) for word in description["origin"].strip("[]").split(",")[:2]])
        image = path.parent / description["image"]
    except KeyError as err:
        raise ResultsError(
            f"{path}: cannot be read as a map: found no {err}, expected 'image', 'resolution' and 'origin'"
        ) from err
    except (OSError, ValueError) as err:
        raise ResultsError(f"{path}: cannot be read as a map: {reason(err)}") from err
    try:
        grey = _read_pgm(image.read_bytes())
    except (OSError, ValueError) as err:
        raise ResultsError(f"{image}: cannot be read as a map: {reason(err)}") from err
    log_odds = np.zeros(grey.shape, dtype=np.float32)
    log_odds[grey < _DARK] = _CERTAIN_LOG_ODDS
    log_odds[grey > _BRIGHT] = -_CERTAIN_LOG_ODDS
    # An image's first row is its top, the grid's first row its bottom.
    return OccupancyGrid(log_odds=log_odds[::-1], origin=origin, resolution=resolution)


def read_geojson(path: Path) -> Landmarks:
    """Read landmarks as `write_geojson` writes them; their shortest distance from the laser is not in the file (NaN).

    Raises:
        ResultsError: the file is missing or not of that form.
    """
    try:
        features = json.loads(path.read_text(encoding="utf-8"))["features"]
        return _landmarks(features)
    except (OSError, ValueError, KeyError, TypeError) as err:
        raise ResultsError(f"{path}: cannot be read as landmarks: {type(err).__name__} {reason(err)}") from err


def read_closures(path: Path) -> tuple[Closure, ...]:
    """Read the loop closures that were tried.

    Raises:
        ResultsError: the file is missing or not of that form.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.reader(file)
            header = next(reader, [])
            if tuple(header) != CLOSURE_COLUMNS:
                found, expected = ",".join(header), ",".join(CLOSURE_COLUMNS)
                raise ResultsError(f"{path}:1: found the header '{found[:80]}', expected '{expected}'")
            return tuple(_closure_at(row, f"{path}:{reader.line_num}") for row in reader)
    except (OSError, ValueError, csv.Error) as err:
        raise ResultsError(f"{path}: cannot be read as loop closures: {reason(err)}") from err


def _closure_at(row: list[str], where: str) -> Closure:
    if len(row) != len(CLOSURE_COLUMNS):
        raise ResultsError(
            f"{where}: found {len(row)} values, expected {len(CLOSURE_COLUMNS)}: {' '.join(CLOSURE_COLUMNS)}"
        )
    try:
        return _closure(dict(zip(CLOSURE_COLUMNS, row, strict=True)))
    except ValueError as err:
        raise ResultsError(f"{where}: cannot be read as a loop closure: {err}") from err


def _closure(row: dict[str, str]) -> Closure:
    verdict = row["verdict"]
    if verdict not in get_args(Verdict):
        raise ValueError(f"found the verdict '{verdict}', expected one of {', '.join(get_args(Verdict))}")
    return Closure(
        scan_i=int(row["scan_i"]),
        scan_j=int(row["scan_j"]),
        T_i_j=np.array([float(row["x_m"]), float(row["y_m"]), float(row["theta_rad"])]),
        score=float(row["score"]),
        inliers=int(row["inliers"]),
        overlap=float(row["overlap"]),
        verdict=cast("Verdict", verdict),
        reason=row["reason"],
    )


def _read_pgm(content: bytes) -> NDArray[np.uint8]:
    header = re.match(rb"P5\s(?:#[^\n]*\n)*(\d+)\s+(\d+)\s+255\s", content)
    if header is None:
        raise ValueError(f"found an image starting with {content[:16]!r}, expected a binary PGM of 8 bits")
    cols, rows = int(header[1]), int(header[2])
    pixels = np.frombuffer(content, dtype=np.uint8, offset=header.end())
    if len(pixels) != rows * cols:
        raise ValueError(f"found {len(pixels)} pixels, expected {cols} x {rows}")
    return pixels.reshape(rows, cols)


def _landmarks(features: list[dict[str, Any]]) -> Landmarks:
    properties = [feature["properties"] for feature in features]
    n = len(features)

    def integers(name: str) -> NDArray[np.int64]:
        return np.array([-1 if entry[name] is None else entry[name] for entry in properties], dtype=np.int64)

    return Landmarks(
        ids=np.array([feature["id"] for feature in features], dtype=np.int64),
        kinds=np.array([KIND_NAMES.index(entry["kind"]) for entry in properties], dtype=np.int8),
        positions=np.array([feature["geometry"]["coordinates"] for feature in features], dtype=float).reshape(n, 2),
        directions=_padded([entry["directions"] for entry in properties]),
        covariances=np.array([entry["covariance"] for entry in properties], dtype=float).reshape(n, 2, 2),
        direction_variances=_padded([entry["direction_variances"] for entry in properties]),
        distances=np.full(n, np.nan),
        anchors=integers("anchor"),
        first_seen=integers("first_seen"),
        last_seen=integers("last_seen"),
        seen=integers("seen"),
        missed=integers("missed"),
        expired_at=integers("expired_at"),
    )


def _padded(rows: list[list[float]]) -> NDArray[np.float64]:
    table = np.full((len(rows), 2), np.nan)
    for row, values in zip(table, rows, strict=True):
        row[: len(values)] = values
    return table
