"""Reading a folder of results back, to draw or study a run without running it again."""

import csv
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graph.counted import counted
from graph.errors import reason
from graph.files import check_file, read_text
from graph.limits import LIMITS, check_limit
from graph.ranges import number_in
from iceg.ice.features import KIND_NAMES
from iceg.maps.feature_map import Landmarks
from iceg.maps.grid import OccupancyGrid
from iceg.results import WALL_COLUMNS, ResultsError, read_covariances, read_summary, whole_results
from iceg.slam.closures.attempt import Verdict
from iceg.slam.closures.closure import CLOSURE_COLUMNS, Closure
from iceg.slam.joint.wall_pieces import WallPieces
from iceg.tables import check_row, open_table, read_csv_table
from iceg.tum import Trajectory, read_tum

_FILES = ("trajectory.tum", "covariances.csv", "closures.csv", "features.geojson", "map.yaml")
_CELLS = (1e-4, 1e6)  # m: the least and the greatest side of a cell
_SIZE_DIGITS = 9
_CERTAIN_LOG_ODDS = 3.0
"""What a black or white cell of map.pgm is read as."""
_DARK, _BRIGHT = 0.35 * 255, 0.804 * 255  # map_server's thresholds on 1 - grey / 255


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFolder:
    """What the files of a run say.

    Attributes:
        log_name: of the log, empty where no summary names it.
        trajectory: stamped T_map_robot of each scan.
        key_scans: (k,) scan index of each key pose.
        key_poses: (k, 3) T_map_robot.
        covariances: (k, 3, 3) in the tangent space at each key pose.
        grid: the occupancy grid; each cell free, occupied or unknown beyond doubt, as its picture has no more.
        landmarks: the feature map.
        closures: loop closures tried.
        walls: short straight pieces of wall; none where poses and map were not refined together, or by an older
            version.
    """

    log_name: str
    trajectory: Trajectory
    key_scans: NDArray[np.int64]
    key_poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    grid: OccupancyGrid
    landmarks: Landmarks
    closures: tuple[Closure, ...]
    walls: WallPieces

    def __repr__(self) -> str:
        accepted = sum(closure.verdict is Verdict.ACCEPTED for closure in self.closures)
        return (
            f"RunFolder({counted(len(self.trajectory), 'scan')}, {counted(len(self.key_scans), 'key pose')}, "
            f"{accepted} of {counted(len(self.closures), 'closure')} accepted, "
            f"{counted(len(self.landmarks.settled()), 'landmark')})"
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
    trajectory, closures = read_tum(directory / "trajectory.tum"), read_closures(directory / "closures.csv")
    _check_scans(directory, len(trajectory), key_scans, closures)
    return RunFolder(
        log_name=log_name(directory),
        trajectory=trajectory,
        key_scans=key_scans,
        key_poses=key_poses,
        covariances=covariances,
        grid=read_ros_map(directory / "map.yaml"),
        landmarks=read_geojson(directory / "features.geojson"),
        closures=closures,
        walls=read_walls(directory / "walls.csv") if (directory / "walls.csv").exists() else WallPieces.none(),
    )


def _check_scans(directory: Path, n_scans: int, key_scans: NDArray[np.int64], closures: tuple[Closure, ...]) -> None:
    """Refuse files that name scans the trajectory does not have: they are not of one run."""
    last = {
        "covariances.csv": int(key_scans.max()),
        "closures.csv": max((max(closure.scan_i, closure.scan_j) for closure in closures), default=-1),
    }
    for name, scan in last.items():
        if scan >= n_scans:
            raise ResultsError(
                f"{directory / name}: found scan {scan}, but trajectory.tum has {n_scans} rows; expected the files of "
                "one run"
            )


def is_of_dp_slam(directory: Path) -> bool:
    """Whether a folder holds what DP-SLAM has written, which is less than what a run leaves.

    Raises:
        ResultsError: its summary cannot be read.
    """
    return (directory / "summary.json").exists() and read_summary(directory).get("method") == "dp-slam"


def log_name(directory: Path) -> str:
    """Name of the log that a run's summary tells, empty without one.

    Raises:
        ResultsError: the summary cannot be read.
    """
    return str(read_summary(directory).get("log", "")) if (directory / "summary.json").exists() else ""


def read_ros_map(path: Path) -> OccupancyGrid:
    """Read a grid as `write_ros_map` writes it: an 8-bit PGM beside its YAML.

    Raises:
        ResultsError: a file is missing or not of that form.
    """
    where = f"{path}: cannot be read as a map"
    text = read_text(path, "settings_bytes", ResultsError, "a map", "ascii")
    try:
        description = dict(line.split(": ", 1) for line in text.splitlines() if line)
        resolution = number_in(description["resolution"], *_CELLS, "a resolution in metres", ResultsError, where)
        origin = _origin(description["origin"], where)
        image = path.parent / description["image"]
    except KeyError as err:
        raise ResultsError(
            f"{path}: cannot be read as a map: found no {err}, expected 'image', 'resolution' and 'origin'"
        ) from err
    except ValueError as err:
        raise ResultsError(f"{path}: cannot be read as a map: {reason(err)}") from err
    check_file(image, "image_bytes", ResultsError, "a map")
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
    text = read_text(path, "table_bytes", ResultsError, "landmarks")
    try:
        return _checked(_landmarks(json.loads(text)["features"]), path)
    except (ValueError, KeyError, TypeError, IndexError, OverflowError, RecursionError) as err:
        shown = str(err)[:120]
        raise ResultsError(f"{path}: cannot be read as landmarks: {type(err).__name__} {shown}") from err


def read_closures(path: Path) -> tuple[Closure, ...]:
    """Read the loop closures that were tried.

    Raises:
        ResultsError: the file is missing or not of that form.
    """
    closures: list[Closure] = []
    with open_table(path, ResultsError, "loop closures") as file:
        reader = csv.reader(file)
        header = next(reader, [])
        if tuple(header) != CLOSURE_COLUMNS:
            found, expected = ",".join(header), ",".join(CLOSURE_COLUMNS)
            raise ResultsError(f"{path}:1: found the header '{found[:80]}', expected '{expected}'")
        for row in reader:
            check_row(len(closures) + 1, f"{path}:{reader.line_num}", ResultsError)
            closures.append(_closure_at(row, f"{path}:{reader.line_num}"))
    return tuple(closures)


def read_walls(path: Path) -> WallPieces:
    """Read the pieces of wall, which may be none.

    Raises:
        ResultsError: the file is missing or not of that form.
    """
    table = read_csv_table(path, WALL_COLUMNS, may_be_empty=True)
    counts = table[:, [4, 6]]
    bad = np.flatnonzero((counts < 0).any(axis=1) | (counts != np.floor(counts)).any(axis=1) | (table[:, 5] < 0))
    if len(bad):
        raise ResultsError(
            f"{path}: row {bad[0] + 1}: found {table[bad[0], 4:].tolist()} for points, deviation_m and key_poses, "
            "expected 0 or more, counts as whole numbers"
        )
    return WallPieces(
        ends=table[:, :4].reshape(-1, 2, 2),
        points=table[:, 4].astype(np.int64),
        deviations=table[:, 5],
        key_poses=table[:, 6].astype(np.int64),
    )


def _origin(text: str, where: str) -> NDArray[np.float64]:
    """(2,) x and y of the lower left corner of a map [m], out of `[x, y, heading]`."""
    words = text.strip().strip("[]").split(",")
    if len(words) < 2:
        raise ResultsError(f"{where}: found the origin '{text[:40]}', expected [x, y, heading]")
    most = LIMITS.coordinate
    return np.array([number_in(word, -most, most, "a place in metres", ResultsError, where) for word in words[:2]])


def _closure_at(row: list[str], where: str) -> Closure:
    if len(row) != len(CLOSURE_COLUMNS):
        raise ResultsError(
            f"{where}: found {len(row)} values, expected {len(CLOSURE_COLUMNS)}: {' '.join(CLOSURE_COLUMNS)}"
        )
    try:
        return _closure(dict(zip(CLOSURE_COLUMNS, row, strict=True)), where)
    except ValueError as err:
        raise ResultsError(f"{where}: cannot be read as a loop closure: {str(err)[:200]}") from err


def _closure(row: dict[str, str], where: str) -> Closure:
    verdict = row["verdict"]
    if verdict not in list(Verdict):
        raise ValueError(f"found the verdict '{verdict[:40]}', expected one of {', '.join(Verdict)}")

    def number(name: str, most: float, least: float = 0.0) -> float:
        if row[name] == "nan" and verdict != "accepted":  # nothing matched
            return math.nan
        return number_in(row[name], least, most, name, ResultsError, where)

    def whole(name: str, most: int) -> int:
        value = number_in(row[name], 0, most, name, ResultsError, where)
        if not value.is_integer():
            raise ValueError(f"found '{row[name][:40]}', expected {name}, a whole number")
        return int(value)

    return Closure(
        scan_i=whole("scan_i", LIMITS.rows),
        scan_j=whole("scan_j", LIMITS.rows),
        T_i_j=np.array([number(name, LIMITS.coordinate, -LIMITS.coordinate) for name in ("x_m", "y_m", "theta_rad")]),
        score=number("score", LIMITS.coordinate, -LIMITS.coordinate),
        inliers=whole("inliers", LIMITS.beams * LIMITS.rows),
        overlap=number("overlap", LIMITS.coordinate),
        verdict=Verdict(verdict),
        reason=row["reason"],
    )


def _read_pgm(content: bytes) -> NDArray[np.uint8]:
    header = re.match(rb"P5\s(?:#[^\n]*\n)*(\d+)\s+(\d+)\s+255\s", content)
    if header is None:
        raise ValueError(f"found an image starting with {content[:16]!r}, expected a binary PGM of 8 bits")
    cols, rows = (int(size) if len(size) <= _SIZE_DIGITS else 0 for size in header.groups())
    if not cols or not rows:
        raise ValueError(f"found an image of {header[1][:20]!r} x {header[2][:20]!r} pixels, expected one or more")
    check_limit(rows * cols, "grid_cells", f"found an image of {cols} x {rows} pixels")
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


def _checked(landmarks: Landmarks, path: Path) -> Landmarks:
    """The landmarks, if they lie where a map can have any."""
    directions = np.nan_to_num(landmarks.directions, nan=0.0, posinf=np.inf, neginf=-np.inf)
    numbers = (landmarks.positions, landmarks.covariances.reshape(-1, 4), directions)
    for values, most in zip(numbers, (LIMITS.coordinate, LIMITS.coordinate**2, LIMITS.heading), strict=True):
        bad = np.flatnonzero(~(np.abs(values) <= most).all(axis=1))
        if len(bad):
            raise ResultsError(
                f"{path}: found {values[bad[0]].tolist()} for landmark {landmarks.ids[bad[0]]}, expected finite "
                f"numbers of at most {most:g}"
            )
    return landmarks


def _padded(rows: list[list[float]]) -> NDArray[np.float64]:
    table = np.full((len(rows), 2), np.nan)
    for row, values in zip(table, rows, strict=True):
        row[: len(values)] = values
    return table
