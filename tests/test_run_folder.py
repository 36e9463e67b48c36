"""What a run has written can be read and drawn again."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from graph.errors import IcegError
from iceg import results
from iceg.ice.features import KIND_NAMES
from iceg.maps.feature_map import Landmarks
from iceg.maps.geojson import write_geojson
from iceg.maps.grid import OccupancyGrid, write_ros_map
from iceg.run_folder import read_run_folder
from iceg.show.run_plots import PICTURES, plot_results
from iceg.slam.closures.attempt import Verdict
from iceg.slam.closures.closure import CLOSURE_COLUMNS, Closure
from iceg.tum import format_tum


def make_landmarks(n: int = 6) -> Landmarks:
    rng = np.random.default_rng(1)
    directions = rng.uniform(-3, 3, (n, 2))
    directions[1::2, 1] = np.nan
    return Landmarks(
        ids=np.arange(n),
        kinds=np.arange(n, dtype=np.int8) % np.int8(len(KIND_NAMES)),
        positions=rng.normal(size=(n, 2)),
        directions=directions,
        covariances=np.broadcast_to(1e-3 * np.eye(2), (n, 2, 2)),
        direction_variances=np.where(np.isnan(directions), np.nan, 1e-4),
        distances=np.ones(n),
        anchors=np.zeros(n, np.int64),
        first_seen=np.zeros(n, np.int64),
        last_seen=np.ones(n, np.int64),
        seen=np.full(n, 5),
        missed=np.arange(n),
        expired_at=np.where(np.arange(n) == 2, 1, -1),
    )


CLOSURES = tuple(
    Closure(
        scan_i=0,
        scan_j=19,
        T_i_j=np.array([0.5, -0.25, 3.0]),
        score=0.75,
        inliers=80,
        overlap=0.5,
        verdict=verdict,
        reason='says "so", and why',
    )
    for verdict in Verdict
)


WALL_HEADER = ",".join(results.WALL_COLUMNS) + "\n"
CLOSURE_HEADER = ",".join(CLOSURE_COLUMNS) + "\n"


@pytest.fixture
def run(tmp_path: Path) -> Any:
    rng = np.random.default_rng(0)
    log_odds = rng.choice(np.array([-1.0, 0.0, 1.0], np.float32), (40, 60))
    trajectory = np.column_stack([np.linspace(0, 2, 20), np.linspace(0, 1, 20), np.linspace(0, 3, 20)])
    result: Any = SimpleNamespace(
        trajectory=trajectory,
        key_scans=np.arange(0, 20, 5),
        key_poses=trajectory[::5],
        covariances=np.broadcast_to(np.diag([1e-4, 4e-4, 1e-5]), (4, 3, 3)),
        grid=OccupancyGrid(log_odds=log_odds, origin=np.array([-0.5, -0.25]), resolution=0.05),
        landmarks=make_landmarks(),
        closures=CLOSURES,
    )
    (tmp_path / "trajectory.tum").write_text(format_tum(np.arange(20.0), trajectory))
    results._write_covariances(result, tmp_path)
    results._write_closures(result, tmp_path)
    write_ros_map(result.grid, tmp_path)
    write_geojson(result.landmarks, tmp_path / "features.geojson")
    return result


def test_everything_reads_back(tmp_path: Path, run: Any) -> None:
    folder = read_run_folder(tmp_path)
    np.testing.assert_allclose(folder.trajectory.poses, run.trajectory, atol=1e-9)
    np.testing.assert_array_equal(folder.key_scans, run.key_scans)
    np.testing.assert_allclose(folder.covariances, run.covariances, rtol=1e-10)
    np.testing.assert_array_equal(folder.grid.classes(), run.grid.classes())
    np.testing.assert_allclose(folder.grid.extent, run.grid.extent)
    for name in ("ids", "kinds", "anchors", "first_seen", "last_seen", "seen", "missed", "expired_at"):
        np.testing.assert_array_equal(getattr(folder.landmarks, name), getattr(run.landmarks, name), err_msg=name)
    for name in ("positions", "directions", "covariances", "direction_variances"):
        np.testing.assert_allclose(
            getattr(folder.landmarks, name), getattr(run.landmarks, name), atol=1e-6, err_msg=name
        )
    for found, written in zip(folder.closures, CLOSURES, strict=True):
        np.testing.assert_array_equal(found.T_i_j, written.T_i_j)
        for name in ("scan_i", "scan_j", "score", "inliers", "overlap", "verdict", "reason"):
            assert getattr(found, name) == getattr(written, name)


def test_pictures_are_drawn_from_the_files_and_are_the_same_each_time(tmp_path: Path, run: Any) -> None:
    assert run is not None
    pictures = plot_results(tmp_path)
    assert [path.name for path in pictures] == [f"{name}.png" for name in PICTURES]
    first = [path.read_bytes() for path in pictures]
    assert all(content.startswith(b"\x89PNG") for content in first)
    assert [path.read_bytes() for path in plot_results(tmp_path)] == first


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("trajectory.tum", "", "trajectory.tum: holds no pose"),
        ("covariances.csv", "a,b\n", "covariances.csv:1: found the header 'a,b'"),
        ("closures.csv", "a,b\n", "closures.csv:1: found the header 'a,b'"),
        ("closures.csv", "", "closures.csv:1: found the header ''"),
        ("closures.csv", f"{CLOSURE_HEADER}1,2\n", "closures.csv:2: found 2 values, expected 10"),
        ("closures.csv", f"{CLOSURE_HEADER}1,2,0,0,0,1,1,1,perhaps,why\n", "closures.csv:2: cannot be read"),
        ("walls.csv", "a,b\n", "walls.csv:1: found the header 'a,b'"),
        ("walls.csv", f"{WALL_HEADER}0,0,1,0,2.5,0.01,3\n", "walls.csv: row 1: found [2.5, 0.01, 3.0] for points"),
        ("map.yaml", "image: none.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n", "none.pgm: cannot be read as a map"),
        ("map.yaml", "resolution: wide\n", "map.yaml: cannot be read as a map: found 'wide', expected a resolution"),
        ("map.yaml", "image: map.pgm\n", "map.yaml: cannot be read as a map: found no 'resolution'"),
        ("map.pgm", "P2\n1 1\n255\n0\n", "map.pgm: cannot be read as a map: found an image"),
        ("map.pgm", "P5\n9 9\n255\nxx", "map.pgm: cannot be read as a map: found 2 pixels, expected 9 x 9"),
        ("features.geojson", "{}", "features.geojson: cannot be read as landmarks"),
        ("features.geojson", '{"features": [{"id": 1}]}', "features.geojson: cannot be read as landmarks"),
        ("features.geojson", "no json", "features.geojson: cannot be read as landmarks"),
    ],
)
def test_a_damaged_file_is_named(tmp_path: Path, run: Any, name: str, content: str, message: str) -> None:
    assert run is not None
    (tmp_path / name).write_text(content)
    with pytest.raises(IcegError) as caught:
        read_run_folder(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path}/{message}")


def test_a_folder_that_is_none_is_named(tmp_path: Path) -> None:
    with pytest.raises(IcegError, match="nowhere: is no folder"):
        read_run_folder(tmp_path / "nowhere")


def test_a_folder_that_no_run_has_written_says_what_it_lacks(tmp_path: Path) -> None:
    (tmp_path / "trajectory.tum").write_text("")
    with pytest.raises(IcegError, match=r"lacks covariances\.csv, .*, expected a folder that 'iceg run' has written"):
        read_run_folder(tmp_path)
