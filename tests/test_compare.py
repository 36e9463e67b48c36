"""Two runs of one log: where they differ, which closures only one has, and the page that shows it."""

import base64
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from graph.se2 import compose
from iceg import results
from iceg.cli import main
from iceg.compare.closure_difference import lone_closures
from iceg.compare.comparison import CompareError, compare_runs
from iceg.compare.map_pair import map_pair
from iceg.maps.geojson import write_geojson
from iceg.maps.grid import OccupancyGrid, write_ros_map
from iceg.run_folder import RunFolder
from iceg.slam.closures.attempt import Verdict
from iceg.slam.closures.closure import Closure
from iceg.slam.joint.wall_pieces import WallPieces
from iceg.tum import Trajectory, format_tum
from tests.test_plots import landmarks, path, room_grid

F64 = NDArray[np.float64]


def run(poses: F64 | None = None, closures: tuple[Closure, ...] = (), deviation: float = 0.01) -> RunFolder:
    """A run of 300 scans, 30 of them key scans, in a room of 8 m x 5 m."""
    poses = path() if poses is None else poses
    key_scans = np.arange(0, len(poses), 10)
    covariances = np.tile(deviation**2 * np.eye(3), (len(key_scans), 1, 1))
    covariances[0] = 0.0
    return RunFolder(
        log_name="room.clf",
        trajectory=Trajectory(stamps=np.arange(len(poses), dtype=np.float64) / 10, poses=poses),
        key_scans=key_scans,
        key_poses=poses[key_scans],
        covariances=covariances,
        grid=room_grid(),
        landmarks=landmarks(),
        closures=closures,
        walls=WallPieces.none(),
    )


def closure(scan_i: int, scan_j: int, verdict: Verdict = Verdict.ACCEPTED, reason: str = "fits") -> Closure:
    return Closure(
        scan_i=scan_i,
        scan_j=scan_j,
        T_i_j=np.zeros(3),
        score=0.9,
        inliers=100,
        overlap=0.8,
        verdict=verdict,
        reason=reason,
    )


def shifted(first: int, last: int, by: float) -> F64:
    poses = path()
    poses[first : last + 1, 0] += by
    return poses


def test_a_run_is_like_itself() -> None:
    comparison = compare_runs(run(), run())
    assert comparison.largest_distance < 1e-12
    assert not comparison.intervals
    assert not comparison.lone_closures
    assert comparison.sigmas.max() < 1e-6


def test_where_a_part_lies_elsewhere_and_by_how_many_sigmas() -> None:
    comparison = compare_runs(run(), run(shifted(100, 195, 0.1)))
    (interval,) = comparison.intervals
    assert (interval.first_scan, interval.last_scan) == (100, 190)
    assert interval.distance == pytest.approx(0.1)
    assert interval.turn == pytest.approx(0.0, abs=1e-12)
    assert interval.sigmas == pytest.approx(0.1 / np.hypot(0.01, 0.01), rel=1e-6)
    assert comparison.mean_distance == pytest.approx(0.1 * 96 / 300)
    assert not compare_runs(run(deviation=0.05), run(shifted(100, 195, 0.1), deviation=0.05)).intervals


def test_the_worst_interval_comes_first() -> None:
    poses = shifted(50, 99, 0.1)
    poses[200:250, 1] -= 0.2
    intervals = compare_runs(run(), run(poses)).intervals
    assert [(interval.first_scan, interval.last_scan) for interval in intervals] == [(200, 240), (50, 90)]


def test_a_map_that_was_turned_is_the_same_map() -> None:
    turned = compose(np.array([3.0, -2.0, np.pi / 2]), path())
    comparison = compare_runs(run(), run(turned))
    assert comparison.largest_distance < 1e-9
    assert not comparison.intervals


def test_the_turned_map_is_drawn_on_the_other() -> None:
    T_b_a = np.array([3.0, -2.0, np.pi / 2])
    straight, grid = run(), room_grid()
    x_min, _, y_min, y_max = grid.extent
    x, y = T_b_a[0] - y_max, T_b_a[1] + x_min  # where the corner at (x_min, y_max) comes to lie
    assert y_min < y_max
    turned_grid = OccupancyGrid(
        log_odds=np.ascontiguousarray(grid.log_odds[::-1].T), origin=np.array([x, y]), resolution=grid.resolution
    )
    turned = replace(run(compose(T_b_a, path())), grid=turned_grid)
    maps = map_pair(straight, turned, [])
    first, second = (np.asarray(Image.open(io.BytesIO(content)).convert("L"), np.int16) for content in (maps.a, maps.b))
    assert first.shape == second.shape == (maps.height, maps.width)
    assert (np.abs(first - second) > 60).mean() < 0.001
    assert (first < 60).mean() > 0.01


def test_closures_that_only_one_has_and_what_the_other_says() -> None:
    a = [closure(0, 250), closure(20, 260), closure(50, 280)]
    b = [closure(8, 252), closure(52, 281, Verdict.REJECTED, "too few inliers"), closure(100, 290)]
    lone, shared = lone_closures(a, b, np.arange(0, 300, 10))
    found = [(one.only_in, one.scan_i, one.scan_j, one.elsewhere) for one in lone]
    assert found == [
        ("A", 20, 260, "not tried"),
        ("A", 50, 280, "rejected: too few inliers"),
        ("B", 100, 290, "not tried"),
    ]
    assert shared == 1


def test_runs_of_different_logs_are_refused() -> None:
    with pytest.raises(CompareError, match="found runs of 300 and 200 scans"):
        compare_runs(run(), run(path()[:200]))


class Page(HTMLParser):
    """What a page refers to, and what it says."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.tags: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.references += [value or "" for name, value in attrs if name in {"src", "href"}]


def written(folder: Path, of: RunFolder) -> Path:
    """The folder of a run as `iceg run` leaves it, as far as it is read."""
    folder.mkdir(parents=True)
    (folder / "trajectory.tum").write_text(format_tum(of.trajectory.stamps, of.trajectory.poses))
    result: Any = of
    results._write_covariances(result, folder)
    results._write_closures(result, folder)
    results._write_walls(result, folder)
    write_ros_map(of.grid, folder)
    write_geojson(of.landmarks, folder / "features.geojson")
    return folder


@pytest.fixture
def folders(tmp_path: Path) -> tuple[str, str]:
    a = written(tmp_path / "a" / "out", run(closures=(closure(0, 250),)))
    b = written(tmp_path / "b" / "out", run(shifted(100, 195, 0.1), (closure(0, 250, Verdict.REMOVED, "<b> & co"),)))
    return str(a), str(b)


def test_the_page_needs_nothing_else_and_tells_all(
    folders: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "compare.html"
    assert main(["compare", *folders, "-o", str(file)]) == 0
    table = capsys.readouterr().out
    assert "A: a/out" in table
    assert re.search(r"100-190 +0\.1000 ", table)
    assert "A: 0 and 250; the other: removed: <b> & co" in table
    text = file.read_text(encoding="utf-8")
    page = Page(text)
    assert len(page.references) == 2
    for reference in page.references:
        head, _, content = reference.partition("base64,")
        assert head == "data:image/png;"
        assert Image.open(io.BytesIO(base64.b64decode(content))).size > (500, 300)
    assert {"input", "script", "style", "svg", "table"} <= set(page.tags)
    assert "http" not in text.replace("http-equiv", "")
    assert "prefers-color-scheme: dark" in text
    assert "removed: &lt;b&gt; &amp; co" in text
    assert "100–190" in text
    assert str(tmp_path) not in text
    assert main(["compare", *folders, "-o", str(tmp_path / "again.html")]) == 0
    assert (tmp_path / "again.html").read_bytes() == file.read_bytes()


def test_figures_for_programs(folders: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", *folders, "-o", str(tmp_path / "page.html"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["a"], found["b"]) == ("a/out", "b/out")
    assert found["largest_distance_m"] == pytest.approx(0.1, abs=1e-6)
    assert found["intervals"][0]["worst_scan"] in range(100, 191)
    assert found["lone_closures"] == [{"only_in": "A", "scan_i": 0, "scan_j": 250, "elsewhere": "removed: <b> & co"}]
