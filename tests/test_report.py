"""The report of a run as a file: complete in itself, the same every time, and no larger than one may send."""

import base64
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import iceg
from frontends.scan import Log
from frontends.simulator.simulation import simulate
from graph.noise import largest_squared_norm
from iceg.config import Config
from iceg.maps.config import GridConfig
from iceg.maps.grid import OccupancyGrid
from iceg.report import write_report
from iceg.report.explained import explained_shares
from iceg.report.grid import grid_payload
from iceg.report.learned import learned_payload
from iceg.report.scans import scans_payload
from iceg.report.settings import changed_settings
from iceg.run_result.slam_result import SlamResult
from iceg.slam.odometry.gyro import GyroFinding

_TYPES = {"f4": np.float32, "f8": np.float64, "i4": np.int32, "u2": np.uint16, "u1": np.uint8}


@pytest.fixture(scope="module")
def result() -> SlamResult:
    return iceg.run(simulate("room", 0).log, Config(grid=GridConfig(resolution=0.1)))


def data_of(page: str) -> dict[str, Any]:
    """What a page shows."""
    match = re.search(r'<script type="application/json" id="run">(.*?)</script>', page)
    assert match is not None
    data: dict[str, Any] = json.loads(match[1])
    return data


def unpacked(array: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(array["base64"]), _TYPES[array["type"]]).reshape(array["shape"])


def test_the_page_holds_the_run(result: SlamResult, tmp_path: Path) -> None:
    write_report(result, tmp_path / "report.html")
    data = data_of((tmp_path / "report.html").read_text(encoding="utf-8"))
    np.testing.assert_allclose(unpacked(data["trajectory"]), result.trajectory, rtol=1e-6)
    np.testing.assert_array_equal(unpacked(data["keys"]["scans"]), result.key_scans)
    ranges = unpacked(data["laser"]["ranges"]) * data["laser"]["unit_m"]
    np.testing.assert_allclose(ranges, np.nan_to_num(result.log.ranges, nan=0.0), atol=0.0006)
    shades = unpacked(data["grid"]["shades"])
    cells = np.stack([shades & 15, shades >> 4], axis=1).ravel()[: result.grid.log_odds.size]
    np.testing.assert_array_equal(cells > 8, result.grid.log_odds.ravel() > 0.0)
    assert len(unpacked(data["factors"]["i"])) == len(result.graph.factors)
    assert len(data["closures"]["reasons"]) == len(result.closures)
    assert [setting["name"] for setting in data["settings"]] == ["grid.resolution"]
    np.testing.assert_allclose(unpacked(data["walls"]["ends"]), result.walls.ends.reshape(-1, 4), atol=1e-4)
    assert data["landmarks"]["settled"] == len(result.landmarks.settled())


def test_closures_tell_how_far_off_the_path_they_were(result: SlamResult, tmp_path: Path) -> None:
    write_report(result, tmp_path / "report.html")
    closures = data_of((tmp_path / "report.html").read_text(encoding="utf-8"))["closures"]
    off = unpacked(closures["off_path"])
    assert len(off) == len(closures["rivals"]) == len(result.closures)
    refused = [k for k, closure in enumerate(result.closures) if "sigma off the path" in closure.reason]
    held = [k for k, closure in enumerate(result.closures) if closure.verdict == "accepted" and off[k] >= 0.0]
    bound = math.sqrt(largest_squared_norm(result.config.loops.path_probability))
    # What was refused on the way may be matched again in the end, where the whole graph has moved the path.
    assert sum(off[k] <= bound for k in held) > 0.5 * len(held) > 0.0
    assert all(off[k] > bound for k in refused)


@pytest.mark.parametrize("has_times", [True, False])
def test_what_was_learned_of_the_gyro_is_told(result: SlamResult, has_times: bool) -> None:
    found = GyroFinding(
        chance=1e-9,
        scale=(0.0, 0.001, 0.98),
        bias=math.radians(0.5),
        delay=0.25,
        deviation=math.radians(0.2),
        deviation_without=math.radians(1.1),
        has_times=has_times,
    )
    told = learned_payload({**result.summary, "gyro": found.record()}, has_odometry=False)
    values = {entry["name"]: entry["value"] for entry in told}
    assert values["Gyro"] == "used for the heading"
    assert values["Gyro, bias"] == f"+0.500 ° per {'second' if has_times else 'scan'}"
    assert values["Gyro behind the scans"] == ("+250 ms" if has_times else "+0.25 scans")
    assert values["Gyro, scatter of a turn"] == "0.20 °, 1.10 ° without it"


def test_a_gyro_that_is_not_used_is_told_with_the_reason(result: SlamResult) -> None:
    record = GyroFinding(rejection="they are all zero").record()
    told = learned_payload({**result.summary, "gyro": record}, has_odometry=False)
    assert {"name": "Gyro", "value": "not used: they are all zero"} in told


def test_the_same_run_gives_the_same_page_that_asks_for_nothing(result: SlamResult, tmp_path: Path) -> None:
    pages = [tmp_path / name for name in ("one.html", "two.html")]
    for path in pages:
        write_report(result, path)
    text = pages[0].read_text(encoding="utf-8")
    assert pages[1].read_text(encoding="utf-8") == text
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r'(?:src|href)="(?!data:|#)', markup)
    assert not re.search(r"url\((?!#)", markup)


def test_a_name_that_is_code_is_shown_and_not_run(result: SlamResult, tmp_path: Path) -> None:
    from dataclasses import replace

    name = "</script><script>alert(1)"
    write_report(replace(result, log=replace(result.log, path=Path(name))), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert data_of(text)["name"].endswith("<script>alert(1)")


def test_a_long_log_is_thinned_but_for_its_key_scans_and_that_is_told() -> None:
    n, beams = 100_000, 180
    log = Log.from_arrays(np.full((n, beams), 5.0, np.float32), field_of_view=3.0)
    key_scans = np.arange(0, n, 17)
    payload = scans_payload(log, key_scans)
    kept = unpacked(payload["scans"])
    assert np.isin(key_scans, kept).all()
    assert (np.diff(kept) > 0).all()
    assert payload["left_out"]["scans"] == n - len(kept) > 0
    assert len(json.dumps(payload)) < 30e6
    wide = scans_payload(Log.from_arrays(np.full((9000, 1081), 5.0, np.float32), field_of_view=3.0), np.arange(9000))
    assert wide["left_out"] == {"scans": 0, "every_beam": 2}
    assert len(json.dumps(wide)) < 30e6


def test_a_huge_grid_gets_coarser_and_keeps_its_walls() -> None:
    log_odds = np.full((4001, 3001), -1.0, np.float32)
    log_odds[2000, 100:200] = 2.0
    payload = grid_payload(OccupancyGrid(log_odds=log_odds, origin=np.zeros(2), resolution=0.05))
    assert (payload["coarser"], payload["rows"], payload["columns"]) == (2, 2001, 1501)
    assert payload["resolution"] == pytest.approx(0.1)
    shades = unpacked(payload["shades"])
    cells = np.stack([shades & 15, shades >> 4], axis=1).ravel()[: 2001 * 1501].reshape(2001, 1501)
    assert (cells[1000, 50:100] == 15).all()
    assert (cells > 8).sum() == 50


def test_a_scan_is_explained_where_its_returns_end_at_walls() -> None:
    log_odds = np.zeros((40, 40), np.float32)
    log_odds[:, 30] = 1.0
    grid = OccupancyGrid(log_odds=log_odds, origin=np.zeros(2), resolution=0.1)
    log = Log.from_arrays(np.full((3, 9), 2.0), bearings=np.linspace(-0.01, 0.01, 9))
    poses = np.array([[1.0, 2.0, 0.0], [0.2, 2.0, 0.0], [1.0, 2.0, np.pi]])
    np.testing.assert_array_equal(explained_shares(log, np.arange(3), poses, grid), [1.0, 0.0, 0.0])


def test_settings_that_differ_are_named_with_their_defaults() -> None:
    assert changed_settings(Config()) == []
    (changed,) = changed_settings(Config(grid=GridConfig(resolution=0.2)))
    assert changed == {"name": "grid.resolution", "value": "0.2", "default": "0.05"}
